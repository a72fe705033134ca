"""What `tune`, scenarios and the command line know by name; importing this loads nothing else.

A motion or an objective is a class in a file of its name, in `motions/` or `objectives/`.
"""

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

MOTIONS = {"uniform": "Uniform", "hermite": "Hermite"}
OBJECTIVES = {"nearest": "Nearest", "fastest": "Fastest", "smoothest": "Smoothest"}


def instances(folder: str, classes: Mapping[str, str]) -> dict[str, Any]:
    """An object of each class, by name."""
    return {name: getattr(import_module(f"{__package__}.{folder}.{name}"), cls)() for name, cls in classes.items()}


def either(names: Iterable[str], quote: str = "'") -> str:
    """The names as a sentence has them: 'a', 'b' or 'c'."""
    *first, last = (f"{quote}{name}{quote}" for name in names)
    return f"{', '.join(first)} or {last}" if first else last
