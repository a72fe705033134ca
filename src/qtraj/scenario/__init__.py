"""Layer 6: models of the TOML scenarios that commands read, and the registry of the kinds of scenarios.

For each kind, a module defines the keys of the scenario and builds the task of the command; the module is imported when
it is needed. The help of the commands and the page that docs/scenarios.py writes are generated from the registry.
"""

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

DATA = Path(__file__).parents[1] / "io" / "data"
"""The folder of the built-in scenarios."""


class Kind(NamedTuple):
    """A kind of scenario.

    `commands`: the commands that read such scenarios. `about`: what the scenarios describe. `file`: the built-in
    scenario in `DATA`. `home`: the module with the model `model_name` and the builder `builder_name`. `renamed` maps
    old dotted keys, which are read until 1.0, to the new names.
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
        """The commands as text, such as "`qtraj tune` and `qtraj evaluate`"."""
        *others, last = (f"`qtraj {command}`" for command in self.commands)
        return f"{', '.join(others)} and {last}" if others else last

    @property
    def embedded(self) -> Path:
        """The built-in scenario, which commands use if no file is specified."""
        return DATA / self.file

    @property
    def model(self) -> Any:
        """The model of the keys, a subclass of `keys.Part`."""
        return self._named(self.model_name)

    @property
    def build(self) -> Callable[..., Any]:
        """The function that builds the task of a command from a `reader.ScenarioFile`."""
        return self._named(self.builder_name)

    def _named(self, name: str) -> Any:
        return getattr(importlib.import_module(f"{__name__}.{self.home}"), name)


KINDS = {
    "path": Kind(
        ("tune", "evaluate", "retime"), "a path and its limits", "default.toml", "path", "PathScenario", "lay"
    ),
    "route": Kind(("route", "retime"), "a recorded drive", "route.toml", "route", "RouteScenario", "fit_recording"),
    "slew": Kind(("slew",), "a slew", "slew.toml", "slew", "SlewScenario", "slew_program"),
    "loop": Kind(
        ("simulate",),
        "a closed loop",
        "simulate.toml",
        "loop",
        "LoopScenario",
        "prepare",
        {"program.turn": "program.slew", "error.gauge": "error.normalization"},
    ),
    "atlas": Kind(("atlas",), "an atlas of tunings", "atlas.toml", "atlas", "AtlasScenario", "atlas_task"),
}
"""All kinds of scenarios by name; to add a kind, write a module and add an entry to this dictionary."""
