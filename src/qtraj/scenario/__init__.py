"""Layer 6: scenarios, the TOML files that commands read. This module is the registry of their kinds.

A kind has a model of its keys, in a module that also builds the task of the command and is imported when needed. The
help of the commands, and the page that docs/scenarios.py writes, come from the kinds.
"""

import importlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

DATA = Path(__file__).parents[1] / "io" / "data"
"""The folder of the embedded scenarios."""


class Kind(NamedTuple):
    """A kind of scenario: the commands that read it, what it describes, its embedded file in `DATA`.

    Its model is the class `model_name` in the module `home`. `renamed`: old keys, with dots, that are still read until
    1.0, and their new names.
    """

    commands: tuple[str, ...]
    about: str
    file: str
    home: str
    model_name: str
    renamed: Mapping[str, str] = MappingProxyType({})

    @property
    def title(self) -> str:
        """The commands in words."""
        return " and ".join(f"`qtraj {command}`" for command in self.commands)

    @property
    def embedded(self) -> Path:
        """The scenario that runs if no file is given."""
        return DATA / self.file

    @property
    def model(self) -> Any:
        """The model of its keys, a subclass of `part.Part`."""
        return getattr(importlib.import_module(f"{__name__}.{self.home}"), self.model_name)


KINDS = {
    "path": Kind(("tune", "evaluate"), "a path and its limits", "default.toml", "path", "PathScenario"),
    "slew": Kind(("slew",), "a slew", "slew.toml", "slew", "SlewScenario"),
    "loop": Kind(
        ("simulate",),
        "a closed loop",
        "simulate.toml",
        "loop",
        "LoopScenario",
        {"program.turn": "program.slew"},
    ),
}
"""Every kind of scenario by its name. A new one is a module and a line here."""
