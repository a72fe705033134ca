"""Vectors as triples of equal arrays: the form in which many instants are worked out at once.

A triple holds x, y and z apart, each over all instants, so that products are elementwise and nothing is interleaved.
`dot` and `cross` take a triple or one vector (3,), and `jet` a list of coefficients that broadcast with the instants.
A term that is known to vanish is the integer 0, and a factor known to be one the integer 1: they cost nothing.
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

Component = Array | int
Triple = tuple[Any, Any, Any]
"""x, y, z: arrays of one shape; an entry that vanishes identically may be the integer 0."""


def mul(a: Any, b: Any) -> Any:
    """a·b, or the integer 0 where one of them is that; the integer 1 leaves the other as it is."""
    if _vanishes(a) or _vanishes(b):
        return 0
    if _is_one(a):
        return b
    return a if _is_one(b) else a * b


def add(terms: Sequence[Any]) -> Any:
    """The sum of the terms that do not vanish identically, or the integer 0."""
    kept = [term for term in terms if not _vanishes(term)]
    if not kept:
        return 0
    result = kept[0]
    for term in kept[1:]:
        result = result + term
    return result


def dot(a: Any, b: Any) -> Any:
    """a·b of two triples, of two vectors (3,), or of two vectors of another kind, which has `@`."""
    if isinstance(a, tuple):
        return add([mul(x, y) for x, y in zip(a, b, strict=True)])
    return a @ b


def cross(a: Any, b: Any) -> Any:
    """a × b of two triples, of two vectors (3,), or of two vectors of another kind, which has `cross`."""
    if isinstance(a, tuple):
        return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return a.cross(b) if hasattr(a, "cross") else jnp.cross(a, b)


def add_vectors(a: Triple, b: Triple) -> Triple:
    """a + b."""
    return (add([a[0], b[0]]), add([a[1], b[1]]), add([a[2], b[2]]))


def scaled(a: Triple, factor: Array) -> Triple:
    """factor·a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def select(condition: Array, a: Triple, b: Triple) -> Triple:
    """`a` where the condition holds, elsewhere `b`."""
    return (jnp.where(condition, a[0], b[0]), jnp.where(condition, a[1], b[1]), jnp.where(condition, a[2], b[2]))


def jet(coefficients: Sequence[Array], t: Array, order: int) -> list[Component]:
    """Taylor coefficients at `t`, orders 0 … `order`, of a polynomial with ascending coefficients.

    As `polynomial.taylor`, for many instants; orders above the degree are the integer 0.
    """
    c = [a + jnp.zeros_like(t) for a in coefficients]
    for k in range(min(order + 1, len(c) - 1)):
        for i in range(len(c) - 2, k - 1, -1):
            c[i] = c[i] + t * c[i + 1]
    return [*c[: order + 1], *[0] * (order + 1 - len(c))]


def _vanishes(x: Any) -> bool:
    return isinstance(x, int) and x == 0


def _is_one(x: Any) -> bool:
    return isinstance(x, int) and x == 1
