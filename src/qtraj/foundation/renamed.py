"""Accept former names of arguments, with a warning, until version 1.0."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def renamed_arguments(**former: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that lets a function accept former keywords, for example `@renamed_arguments(old="new")`.

    The use of a former keyword issues a DeprecationWarning. A call with both the former and the new keyword raises a
    TypeError.
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
