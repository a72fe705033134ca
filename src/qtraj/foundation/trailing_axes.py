"""Check the last axes of quaternions, vectors and matrices; leading axes are batch axes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from qtraj.foundation.types import DualQuat, Mat3, Mat4, Quat, Vec3

TRAILING: dict[Any, tuple[int, ...]] = {Quat: (4,), Vec3: (3,), Mat3: (3, 3), Mat4: (4, 4), DualQuat: (8,)}
"""The shape of the last axes of arrays of each type."""


def trailing_shapes(function: Any) -> tuple[tuple[str, tuple[int, ...]] | None, ...]:
    """Return name and shape of the last axes of each argument of a function, None where any shape is accepted."""
    annotations = getattr(function, "__annotations__", {})
    code = getattr(function, "__code__", None)
    names = () if code is None else code.co_varnames[: code.co_argcount]
    return tuple((name, TRAILING[annotations[name]]) if annotations.get(name) in TRAILING else None for name in names)


def require_trailing(
    function: Any, shapes: tuple[Any, ...], values: Sequence[Any], named: Mapping[str, Any] | None = None
) -> None:
    """Raise a ValueError if the last axes of an argument have another shape."""
    pairs = list(zip(shapes, values, strict=False))
    if named:
        pairs += [
            (expected, named[expected[0]]) for expected in shapes if expected is not None and expected[0] in named
        ]
    for expected, x in pairs:
        if expected is not None and np.shape(x)[-len(expected[1]) :] != expected[1]:
            name, shape = expected
            text = ", ".join(map(str, shape))
            raise ValueError(
                f"{function.__name__}: {name} must have shape (..., {text}), but shape {np.shape(x)} was given"
            )
