"""Check the types of the arguments of public functions."""

import re
import sys
from types import UnionType
from typing import Any

import numpy as np

SHOWN = 60
"""Maximum number of characters of an argument in a message."""

_AN = re.compile(r"(?!uint|uni[cfqtv]|use)[aeiou]", re.IGNORECASE)
"""The start of a name that begins with the sound of a vowel."""


def require_type(value: Any, kind: type | UnionType, name: str, expected: str, advice: str = "") -> None:
    """Raise a ValueError if the argument `name` is not an instance of `kind`; `expected` describes what is.

    `advice` is added to the message.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be {expected}, but {described(value)} was given{advice and ': '}{advice}")


def is_whole(value: Any) -> bool:
    """Return whether a value is a whole number: an integer of Python or NumPy, but not a truth value."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def require_whole(value: Any, name: str, least: int = 0) -> None:
    """Raise a ValueError unless the argument `name` is a whole number, at least `least`."""
    if not is_whole(value) or value < least:
        raise ValueError(f"{name} must be a whole number, at least {least}, but {described(value)} was given")


def described(value: Any) -> str:
    """Return a short description of an argument of a wrong type, such as "the tuple (1, 2)" or "a SpiralHelix"."""
    if value is None:
        return "None"
    kind = type(value).__name__
    if isinstance(value, np.generic):
        return f"the {kind} {value}"
    if isinstance(value, str | int | float | complex | tuple | list | dict | set):
        text = repr(value)
        return f"the {kind} {text if len(text) <= SHOWN else text[: SHOWN - 1] + '…'}"
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    jax = sys.modules.get("jax")  # not imported only for this message
    if jax is not None and isinstance(value, jax.Array):
        return f"a JAX array of shape {value.shape} and dtype {value.dtype}"
    return f"{'an' if _AN.match(kind) else 'a'} {kind}"
