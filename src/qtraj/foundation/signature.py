"""Check how functions of users can be called."""

import inspect
from collections.abc import Callable
from typing import Any

from qtraj.foundation.suggestion import suggestion


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


def require_options(call: Callable[..., Any], options: dict[str, Any], function: Callable[..., Any]) -> None:
    """Raise a TypeError in the name of `call` for options that `function`, to which it passes them, does not have."""
    named = inspect.signature(call).parameters
    known = [name for name in inspect.signature(function).parameters if name not in named]
    if unknown := [name for name in options if name not in known]:
        own = [name for name, x in named.items() if x.kind is not inspect.Parameter.VAR_KEYWORD]
        raise TypeError(
            f"{call.__name__}() got an unexpected keyword argument {unknown[0]!r}; "
            f"{suggestion(unknown[0], [*own, *known], 'arguments')}"
        )
