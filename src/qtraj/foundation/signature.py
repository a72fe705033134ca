"""Check how functions of users can be called."""

import inspect
from collections.abc import Callable
from typing import Any


def accepts(function: Callable[..., Any], count: int) -> bool:
    """Return whether a function can be called with `count` arguments; true if its signature is not known and count 1.

    Functions written in C may have no signature; if their arguments are wrong, the call fails.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return count == 1
    try:
        signature.bind(*range(count))
    except TypeError:
        return False
    return True
