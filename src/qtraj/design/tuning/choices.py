"""Names of motions and objectives, for `tune`, scenarios and the command line.

A motion or an objective is a class in a file of the same name, in `motions/` or `objectives/`. Importing this module
does not import these classes.
"""

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

MOTIONS = {"uniform": "Uniform", "hermite": "Hermite"}
OBJECTIVES = {"nearest": "Nearest", "fastest": "Fastest", "smoothest": "Smoothest"}


def instances(package: str, classes: Mapping[str, str]) -> dict[str, Any]:
    """Return one instance of each class, by name."""
    return {name: getattr(import_module(f"{__package__}.{package}.{name}"), cls)() for name, cls in classes.items()}


def either(names: Iterable[str], quote: str = "'") -> str:
    """Join names to an English list such as 'a', 'b' or 'c'."""
    *first, last = (f"{quote}{name}{quote}" for name in names)
    return f"{', '.join(first)} or {last}" if first else last
