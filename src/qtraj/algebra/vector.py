"""Lengths and directions of vectors, with finite values and gradients also for tiny and zero vectors."""

import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.types import Flag, Scalar

Vector = Float[Array, " n"]


def norm(v: Vector) -> Scalar:
    """Length of `v`, without underflow or overflow; its gradient at the zero vector is zero."""
    w, scale, zero = _scaled(v)
    return jnp.where(zero, 0.0, scale * jnp.sqrt(_squares(w, zero)))


def unit(v: Vector, fallback: Vector) -> Vector:
    """Direction of `v`, or `fallback` (with zero gradient in `v`) where `v` vanishes."""
    w, _, zero = _scaled(v)
    return jnp.where(zero, fallback, w / jnp.sqrt(_squares(w, zero)))


def balanced(v: Vector) -> Vector:
    """`v` with its largest component scaled to ±1, for formulas that are homogeneous of degree 0 in `v`.

    The scale is a constant to differentiation, which is exact for such formulas. The zero vector gives NaN.
    """
    return v / stop_gradient(jnp.max(jnp.abs(v)))


def _scaled(v: Vector) -> tuple[Vector, Scalar, Flag]:
    """`v` divided by its largest absolute component, that component, and whether `v` is zero.

    Differentiation treats the component as a constant.
    """
    size = stop_gradient(jnp.max(jnp.abs(v)))
    zero = size < jnp.finfo(size.dtype).tiny  # false for NaN, which must pass through
    scale = jnp.where(zero, 1.0, size)
    return v / scale, scale, zero


def _squares(w: Vector, zero: Flag) -> Scalar:
    """w·w, or 1 for the zero vector, which keeps the backward pass finite."""
    return jnp.where(zero, 1.0, jnp.sum(w * w))
