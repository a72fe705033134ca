"""Layer 6: scenarios, what a command is to do, as TOML files. This module is the registry of their kinds.

A kind is a model of the keys, in a module that also says what comes of them; both are imported when they are needed.
The commands take their help from the kinds, docs/scenarios.py the page of all keys.
"""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

DATA = Path(__file__).parents[1] / "io" / "data"
"""Where the embedded scenarios lie."""


class Kind(NamedTuple):
    """A kind of scenario: the commands that read it, what it describes, and where its model is.

    `renamed`: old keys, with dots, that are still read until 1.0, and the new names of their last part.
    """

    commands: tuple[str, ...]
    about: str
    home: str
    names: tuple[str, str]
    file: str
    renamed: dict[str, str]

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
        return getattr(importlib.import_module(self.home), self.names[0])

    @property
    def build(self) -> Callable[..., Any]:
        """What makes the task of the command from a `reader.ScenarioFile`."""
        return getattr(importlib.import_module(self.home), self.names[1])


_HOME = "qtraj.scenario"
KINDS = {
    "path": Kind(
        ("tune", "evaluate"), "a path and its limits", f"{_HOME}.path", ("PathScenario", "lay"), "default.toml", {}
    ),
    "slew": Kind(("slew",), "a slew", f"{_HOME}.slew", ("SlewScenario", "slew_program"), "slew.toml", {}),
    "loop": Kind(
        ("simulate",),
        "a closed loop",
        f"{_HOME}.loop",
        ("LoopScenario", "prepare"),
        "simulate.toml",
        {"program.turn": "slew"},
    ),
}
"""Every kind of scenario by its name. A new one is a module and a line here."""
