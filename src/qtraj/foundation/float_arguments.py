"""Let functions of quaternions and vectors accept lists and integers, and check the shapes of these arguments."""

import functools
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from qtraj.foundation.devices import on_one_device
from qtraj.foundation.namespace import as_floats
from qtraj.foundation.trailing_axes import TRAILING

BY_NAME = {str(kind): shape for kind, shape in TRAILING.items()}

Function = TypeVar("Function", bound=Callable[..., Any])


def float_arguments(function: Function) -> Function:
    """Convert the arguments that are annotated as quaternions or vectors to floats; leading axes are a batch."""
    return _converting(function, single=False)


def single_arguments(function: Function) -> Function:
    """Convert arguments as `float_arguments` does, and refuse batches, with the advice to use `jax.vmap`."""
    return _converting(function, single=True)


def _shape(annotation: Any) -> tuple[int, ...] | None:
    """Return the shape of the last axes of a type, or of a type or None; annotations may be postponed."""
    kinds = annotation.split(" | ") if isinstance(annotation, str) else [annotation, *typing.get_args(annotation)]
    return next((BY_NAME[str(kind)] for kind in kinds if str(kind) in BY_NAME), None)


def _converting(function: Function, single: bool) -> Function:
    code = getattr(function, "__wrapped__", function).__code__
    names = code.co_varnames[: code.co_argcount]
    found = {name: _shape(function.__annotations__.get(name)) for name in names}
    shapes = {name: shape for name, shape in found.items() if shape is not None}
    called = function.__qualname__.split(".")[0] if function.__name__ == "__call__" else function.__name__

    def converted(name: str, value: Any) -> Any:
        if name not in shapes or value is None:
            return value
        array, shape = as_floats(value), shapes[name]
        actual = np.shape(array)
        if actual[-len(shape) :] != shape or (single and actual != shape):
            expected = ", ".join(map(str, shape)) + ("," if single and len(shape) == 1 else "")
            advice = ": use jax.vmap for a batch" if single and actual[-len(shape) :] == shape else ""
            wanted = expected if single else f"..., {expected}"
            raise ValueError(f"{called}: {name} must have shape ({wanted}), but shape {actual} was given{advice}")
        return array

    @on_one_device
    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        values = [converted(*pair) for pair in zip(names, args, strict=False)]
        return function(*values, *args[len(names) :], **{name: converted(name, x) for name, x in kwargs.items()})

    return call  # type: ignore[return-value]
