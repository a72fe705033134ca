"""Former names of arguments, which are accepted with a warning until 1.0."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def renamed_arguments(**former: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function accept former keywords: `@renamed_arguments(old="new")`.

    A former keyword issues a DeprecationWarning. Passing both names raises a TypeError.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        name = function.__qualname__.removesuffix(".__init__")

        @functools.wraps(function)
        def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
            present: dict[str, Any] = dict(kwargs)
            for old in former.keys() & kwargs.keys():
                new = former[old]
                if new in kwargs:
                    raise TypeError(f"{name}() got both {new!r} and its former name {old!r}")
                warnings.warn(
                    f"the argument {old!r} of {name}() is now called {new!r}",
                    DeprecationWarning,
                    stacklevel=2,
                )
                present[new] = present.pop(old)
            return function(*args, **present)  # pyright: ignore[reportCallIssue]

        return wrapper

    return decorate
