"""Norms and directions of vectors; `norm` and `unit` have finite values and gradients even for tiny and zero vectors.

A vector counts as zero if all its components are smaller in magnitude than the smallest normal number.
"""

import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.types import Flag, Scalar

Vector = Float[Array, " n"]


def norm(v: Vector) -> Scalar:
    """Return the Euclidean norm of `v`, without underflow or overflow; its gradient at the zero vector is zero."""
    w, scale, zero = _scaled(v)
    return jnp.where(zero, 0.0, scale * jnp.sqrt(_squares(w, zero)))


def unit(v: Vector, fallback: Vector) -> Vector:
    """Return the direction of `v`, or `fallback` if `v` is zero; the gradient with respect to `v` is then zero."""
    w, _, zero = _scaled(v)
    return jnp.where(zero, fallback, w / jnp.sqrt(_squares(w, zero)))


def balanced(v: Vector) -> Vector:
    """Divide `v` by its largest absolute component, for formulas that are homogeneous of degree 0 in `v`.

    The divisor is treated as constant in differentiation, which is exact for such formulas. A vector of zeros yields
    NaN.
    """
    return v / stop_gradient(jnp.max(jnp.abs(v)))


def _scaled(v: Vector) -> tuple[Vector, Scalar, Flag]:
    """Return `v` divided by its largest absolute component, the divisor, and whether `v` is zero.

    If `v` is zero, the divisor is 1. The divisor is treated as constant in differentiation.
    """
    size = stop_gradient(jnp.max(jnp.abs(v)))
    zero = size < jnp.finfo(size.dtype).tiny  # false for NaN, so that the result is NaN
    scale = jnp.where(zero, 1.0, size)
    return v / scale, scale, zero


def _squares(w: Vector, zero: Flag) -> Scalar:
    """Return w·w, or 1 where `zero` is true, which keeps the derivative of its square root finite in reverse mode."""
    return jnp.where(zero, 1.0, jnp.sum(w * w))
