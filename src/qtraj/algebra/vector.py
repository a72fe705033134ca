"""Norms, directions and products of vectors on the last axis of arrays.

`norm` and `unit` have finite values and gradients even for tiny and zero vectors. A vector counts as zero if all its
components are smaller in magnitude than the smallest normal number.
"""

from jaxtyping import Array, Float

from qtraj.foundation.namespace import stop_gradient, xp
from qtraj.foundation.types import Flag, Scalar

Vector = Float[Array, "*batch n"]


def dot(a: Vector, b: Vector) -> Scalar:
    """Return the scalar product a·b."""
    return xp.sum(a * b, axis=-1)


def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a × b of vectors with three components."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return xp.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def norm(v: Vector) -> Scalar:
    """Return the Euclidean norm of `v`, without underflow or overflow; its gradient at the zero vector is zero."""
    w, scale, zero = _scaled(v)
    return xp.where(zero[..., 0], 0.0, scale[..., 0] * xp.sqrt(_squares(w, zero)[..., 0]))


def unit(v: Vector, fallback: Vector) -> Vector:
    """Return the direction of `v`, or `fallback` if `v` is zero; the gradient with respect to `v` is then zero."""
    w, _, zero = _scaled(v)
    return xp.where(zero, fallback, w / xp.sqrt(_squares(w, zero)))


def balanced(v: Vector) -> Vector:
    """Divide `v` by its largest absolute component, for formulas that are homogeneous of degree 0 in `v`.

    The divisor is treated as constant in differentiation, which is exact for such formulas. A vector of zeros yields
    NaN.
    """
    return v / stop_gradient(xp.max(abs(v), axis=-1, keepdims=True))


def _scaled(v: Vector) -> tuple[Vector, Scalar, Flag]:
    """Return `v` divided by its largest absolute component, the divisor, and whether `v` is zero, with one component.

    If `v` is zero, the divisor is 1. The divisor is treated as constant in differentiation.
    """
    size = stop_gradient(xp.max(abs(v), axis=-1, keepdims=True))
    zero = size < float(xp.finfo(size.dtype).tiny)  # false for NaN, so that the result is NaN
    scale = xp.where(zero, 1.0, size)
    return v / scale, scale, zero


def _squares(w: Vector, zero: Flag) -> Scalar:
    """Return w·w, or 1 where `zero` is true, which keeps the derivative of its square root finite in reverse mode."""
    return xp.where(zero, 1.0, xp.sum(w * w, axis=-1, keepdims=True))
