"""Products and sums of vectors and of their derivatives in several directions, for the expansions of constraints."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.algebra.sparse import add, is_zero
from qtraj.path.components import Triple, add_vectors, cross, dot


def vectors(r: Array) -> list[Triple]:
    """Split an array of vectors (…, orders, 3, instants) into one triple of components (…, instants) for each order."""
    return [(r[..., k, 0, :], r[..., k, 1, :], r[..., k, 2, :]) for k in range(r.shape[-3])]


def broadcast(v: Triple) -> Triple:
    """Return the vector with a new first axis for the directions."""
    return (v[0][None], v[1][None], v[2][None])


# Compiled functions are traced once for each shape, not at each call.
compiled_dot, compiled_cross = jax.jit(dot), jax.jit(cross)


@jax.jit
def along(v: Triple, w: Triple) -> Array:
    """Return the scalar products of the vector v with the vectors w in all directions."""
    return dot(broadcast(v), w)


@jax.jit
def change(a_w: Any, a: Any, b_w: Any, b: Any) -> Array:
    """Return the derivatives of a·b in all directions; `a_w` and `b_w` are the derivatives of a and b."""
    return add([a_w[k] * b[k][None] + b_w[k] * a[k][None] for k in range(len(a))])


@jax.jit
def cross_change(a_w: Triple, a: Triple, b_w: Triple, b: Triple) -> Triple:
    """Return the derivatives of a × b in all directions; `a_w` and `b_w` are the derivatives of a and b."""
    return add_vectors(cross(a_w, broadcast(b)), cross(broadcast(a), b_w))


@jax.jit
def outer_sum(a: tuple[Array, ...], b: tuple[Array, ...]) -> Array:
    """Return the scalar products of the vectors `a` and `b` for all pairs of directions."""
    return add([x[:, None] * y[None] for x, y in zip(a, b, strict=True)])


def add_scaled(v: Triple, w: Triple, weight: Array, axes: int) -> Triple:
    """Return v + weight·w, without the vertical component of w if `axes` is 2."""
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
    """Return a component as an array; the integer 0 becomes an array of zeros."""
    return jnp.zeros_like(like) if isinstance(x, int) else x
