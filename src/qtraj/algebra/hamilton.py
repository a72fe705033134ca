"""Quaternions component by component: four numbers, or four arrays over many quaternions.

`quaternion` has the conventions, and the same functions of one quaternion (4,).
"""

from typing import Any

Components = Any
"""w, x, y, z: a tuple of four arrays of one shape, or one array (4,)."""


def product(p: Components, q: Components) -> tuple[Any, Any, Any, Any]:
    """p∘q by Hamilton's rule."""
    a, b, c, d = p
    s, x, y, z = q
    return (
        a * s - b * x - c * y - d * z,
        a * x + b * s + c * z - d * y,
        a * y - b * z + c * s + d * x,
        a * z + b * y - c * x + d * s,
    )


def is_negative(q: Components) -> Any:
    """Whether the first non-zero component is negative."""
    s, x, y, z = q
    return _negative(s, _negative(x, _negative(y, z < 0)))


def _negative(x: Any, next_is: Any) -> Any:
    return (x < 0) | ((x == 0) & next_is)
