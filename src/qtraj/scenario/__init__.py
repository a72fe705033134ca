"""Layer 6: scenarios, what a command is to do, as TOML files. This module is the registry of their kinds.

A kind is a model of the keys, in a module that also says what comes of them; both are imported when they are needed.
The commands take their help from the kinds, docs/scenarios.py the page of all keys.
"""

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

DATA = Path(__file__).parents[1] / "io" / "data"
"""Where the embedded scenarios lie."""


class Kind(NamedTuple):
    """A kind of scenario: the commands that read it, what it describes, its embedded file in `DATA`.

    Its model and its builder are in the module `home`, under these names. `renamed`: old keys, with dots, that are
    still read until 1.0, and their new names.
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
        """The commands as a text."""
        return " and ".join(f"`qtraj {command}`" for command in self.commands)

    @property
    def embedded(self) -> Path:
        """The scenario that runs where none is named."""
        return DATA / self.file

    @property
    def model(self) -> Any:
        """The class of its keys, a `part.Part`."""
        return getattr(importlib.import_module(f"{__name__}.{self.home}"), self.model_name)

    @property
    def build(self) -> Callable[..., Any]:
        """What makes the task of the command from a `reader.ScenarioFile`."""
        return getattr(importlib.import_module(f"{__name__}.{self.home}"), self.builder_name)


KINDS = {
    "path": Kind(("tune", "evaluate"), "a path and its limits", "default.toml", "path", "PathScenario", "lay"),
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
"""Every kind of scenario by its name. A new one is a module and a line here."""
