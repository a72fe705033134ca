"""Vectors as triples of arrays of one shape, for evaluation at many instants at once.

A triple contains x, y and z as separate arrays over all instants, so that all products are elementwise. `dot` and
`cross` also accept vectors (3,). A component that is identically zero may be the integer 0 (`algebra.sparse`).
"""

from typing import Any

from jaxtyping import Array

from qtraj.algebra import vector
from qtraj.algebra.sparse import add, mul, sub
from qtraj.foundation.namespace import xp

Triple = tuple[Any, Any, Any]
"""Components x, y, z as arrays of one shape; a component that is identically zero may be the integer 0."""


def dot(a: Any, b: Any) -> Any:
    """Return a·b of two triples, two vectors (3,), or two vectors of another type that supports `@`."""
    if isinstance(a, tuple):
        return add([mul(x, y) for x, y in zip(a, b, strict=True)])
    return a @ b


def cross(a: Any, b: Any) -> Any:
    """Return a × b of two triples, two vectors (3,), or two vectors of another type with a method `cross`."""
    if isinstance(a, tuple):
        return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return a.cross(b) if hasattr(a, "cross") else vector.cross(a, b)


def add_vectors(a: Triple, b: Triple) -> Triple:
    """Return the sum of two triples."""
    return (add([a[0], b[0]]), add([a[1], b[1]]), add([a[2], b[2]]))


def scaled(a: Triple, factor: Any) -> Triple:
    """Return the triple multiplied by `factor`."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def rotated_z(v: Any, cos: Any, sin: Any) -> Triple:
    """Rotate the triple `v` about the third axis by the angle with the cosine `cos` and the sine `sin`."""
    x, y, z = v
    return sub(mul(x, cos), mul(y, sin)), add([mul(x, sin), mul(y, cos)]), z


def select(condition: Array, a: Triple, b: Triple) -> Triple:
    """Select `a` where the condition is true, and `b` elsewhere."""
    return (xp.where(condition, a[0], b[0]), xp.where(condition, a[1], b[1]), xp.where(condition, a[2], b[2]))
