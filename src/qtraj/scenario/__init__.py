"""Layer 6: scenarios, the TOML files that commands read. This module is the registry of their kinds.

A kind has a model of its keys, in a module that also builds the task of the command and is imported when needed. The
help of the commands, and the page that docs/scenarios.py writes, come from the kinds.
"""

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

DATA = Path(__file__).parents[1] / "io" / "data"
"""The folder of the built-in scenarios."""


class Kind(NamedTuple):
    """A kind of scenario: the commands that read it, what it describes, its embedded file in `DATA`.

    Its model and its builder are in the module `home`, under the names `model_name` and `builder_name`. `renamed` maps
    old dotted keys, which are read until 1.0, to their new names.
    """

    commands: tuple[str, ...]
    about: str
    file: str
    home: str
    model_name: str
    builder_name: str
    renamed: Mapping[str, str] = MappingProxyType({})

    @property
    def title(self) -> str:
        """The commands in words."""
        return " and ".join(f"`qtraj {command}`" for command in self.commands)

    @property
    def embedded(self) -> Path:
        """The built-in scenario, which runs if no file is given."""
        return DATA / self.file

    @property
    def model(self) -> Any:
        """The model of its keys, a subclass of `part.Part`."""
        return self._named(self.model_name)

    @property
    def build(self) -> Callable[..., Any]:
        """The function that builds the task of a command from a `reader.ScenarioFile`."""
        return self._named(self.builder_name)

    def _named(self, name: str) -> Any:
        return getattr(importlib.import_module(f"{__name__}.{self.home}"), name)


KINDS = {
    "path": Kind(("tune", "evaluate"), "a path and its limits", "default.toml", "path", "PathScenario", "lay"),
    "route": Kind(("route",), "a recorded drive", "route.toml", "route", "RouteScenario", "fit_recording"),
    "slew": Kind(("slew",), "a slew", "slew.toml", "slew", "SlewScenario", "slew_program"),
    "loop": Kind(
        ("simulate",),
        "a closed loop",
        "simulate.toml",
        "loop",
        "LoopScenario",
        "prepare",
        {"program.turn": "program.slew"},
    ),
}
"""All kinds of scenarios by name. To add one, write a module and add a line here."""
