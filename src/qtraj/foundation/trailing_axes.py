"""Check the last axes of quaternions, vectors and matrices; leading axes are batch axes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from qtraj.foundation.types import Mat3, Mat4, Quat, Vec3

TRAILING: dict[Any, tuple[int, ...]] = {Quat: (4,), Vec3: (3,), Mat3: (3, 3), Mat4: (4, 4)}
"""The shape of the last axes of arrays of each type."""


def trailing_shapes(function: Any) -> tuple[tuple[str, tuple[int, ...]] | None, ...]:
    """Return name and shape of the last axes of each argument of a function, None where any shape is accepted."""
    annotations = getattr(function, "__annotations__", {})
    code = getattr(function, "__code__", None)
    names = () if code is None else code.co_varnames[: code.co_argcount]
    return tuple((name, TRAILING[annotations[name]]) if annotations.get(name) in TRAILING else None for name in names)


def require_trailing(function: Any, shapes: tuple[Any, ...], values: Sequence[Any]) -> None:
    """Raise a ValueError if the last axes of an argument have another shape."""
    for expected, x in zip(shapes, values, strict=False):
        if expected is not None and np.shape(x)[-len(expected[1]) :] != expected[1]:
            name, shape = expected
            text = ", ".join(map(str, shape))
            raise ValueError(
                f"{function.__name__}: {name} must have shape (..., {text}), but shape {np.shape(x)} was given"
            )
