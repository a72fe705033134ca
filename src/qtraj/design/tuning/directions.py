"""Products and sums of vectors and of their derivatives in many directions, for the expansions of constraints."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.algebra.sparse import add, is_zero
from qtraj.path.components import Triple, add_vectors, cross, dot


def vectors(r: Array) -> list[Triple]:
    """Vectors (*rest, orders, 3, places) as triples of arrays (*rest, places), one triple for each order."""
    return [(r[..., k, 0, :], r[..., k, 1, :], r[..., k, 2, :]) for k in range(r.shape[-3])]


def broadcast(v: Triple) -> Triple:
    """The vector with a new first axis, for the directions."""
    return (v[0][None], v[1][None], v[2][None])


# Compiled as functions, these are traced once for all their uses.
compiled_dot, compiled_cross = jax.jit(dot), jax.jit(cross)


@jax.jit
def along(v: Triple, w: Triple) -> Array:
    """The scalar products of v with all directions w."""
    return dot(broadcast(v), w)


@jax.jit
def change(a_w: Any, a: Any, b_w: Any, b: Any) -> Array:
    """The derivatives of a·b."""
    return add([a_w[k] * b[k][None] + b_w[k] * a[k][None] for k in range(len(a))])


@jax.jit
def cross_change(a_w: Triple, a: Triple, b_w: Triple, b: Triple) -> Triple:
    """The derivatives of a × b."""
    return add_vectors(cross(a_w, broadcast(b)), cross(broadcast(a), b_w))


@jax.jit
def outer_sum(a: tuple[Array, ...], b: tuple[Array, ...]) -> Array:
    """The sum of the products of all pairs of directions."""
    return add([x[:, None] * y[None] for x, y in zip(a, b, strict=True)])


def add_scaled(v: Triple, w: Triple, weight: Array, axes: int) -> Triple:
    """v + weight·w, without the vertical component of w if `axes` is 2."""
    if any(is_zero(x) for x in v):
        return add_vectors(v, tuple(_scaled(w[:axes], weight)) + (0,) * (3 - axes))
    return _plus_scaled(v[:axes], w[:axes], weight) + v[axes:]


@jax.jit
def _scaled(w: tuple[Array, ...], weight: Array) -> tuple[Array, ...]:
    weight = jnp.expand_dims(weight, range(w[0].ndim - 1))
    return tuple(weight * x for x in w)


@jax.jit
def _plus_scaled(v: tuple[Array, ...], w: tuple[Array, ...], weight: Array) -> tuple[Array, ...]:
    return tuple(x + y for x, y in zip(v, _scaled(w, weight), strict=True))


def as_array(x: Any, like: Array) -> Array:
    """The component as an array; zeros for the integer 0."""
    return jnp.zeros_like(like) if isinstance(x, int) else x
