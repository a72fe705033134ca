"""Rates of rotation vectors and Euler angles, and the angular rate that they cause.

For a rotation vector v with [v×] the matrix of the cross product and θ = |v|, the angular rate is ω = J v̇ with

    J_left = E + (1 − cos θ)/θ² [v×] + (θ − sin θ)/θ³ [v×]²  (inertial axes),   J_right = J_leftᵀ  (body axes).

(Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, section 10.6; E is the identity matrix.)
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.algebra.euler import parse, turn
from qtraj.algebra.polynomial import horner
from qtraj.algebra.quaternion import conjugate, product, rotate
from qtraj.algebra.vector import cross, dot
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import of_arrays, xp
from qtraj.foundation.types import Mat3, Scalar, Vec3

TERMS = 12
SMALL_SQUARE = 1.0
"""Below this value of θ², the coefficients of the Jacobians are computed by series, which are exact to round-off."""

SERIES = {m: [(-1) ** k / math.factorial(2 * k + m) for k in range(TERMS)] for m in (2, 3)}
"""The coefficients of (1 − cos θ)/θ² and (θ − sin θ)/θ³ in powers of θ²."""

BERNOULLI = (1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510, 43867 / 798, 174611 / 330)
"""The absolute values of the Bernoulli numbers B2, B4, …, B20, for the series of θ/2 cot θ/2."""

LOCK = 64
"""Angles are in gimbal lock if the determinant of the rates is below this multiple of the machine epsilon."""


@of_arrays
def left_jacobian(v: Vec3) -> Mat3:
    """Return the left Jacobian (..., 3, 3) of SO(3) at the rotation vector `v` (..., 3) [rad].

    It maps the rate v̇ [rad/s] to the angular rate [rad/s] in inertial axes. Values and derivatives are finite for all
    v; the matrix is singular for |v| = 2π, 4π, ….
    """
    first, second = _coefficients(dot(v, v))

    def column(e: Vec3) -> Vec3:
        once = cross(v, e)
        return e + first * once + second * cross(v, once)

    return _columns_of(column, v)


@of_arrays
def left_jacobian_derivative(v: Vec3, u: Vec3) -> Mat3:
    """Return the derivative (..., 3, 3) of `left_jacobian` at `v` (..., 3) [rad] in the direction `u` (..., 3)."""
    v, u = xp.broadcast_arrays(v, u)
    x, slope = dot(v, v), 2 * dot(v, u)[..., None]
    (first, second), (first_slope, second_slope) = _coefficients(x), _coefficient_slopes(x)

    def column(e: Vec3) -> Vec3:
        once, other = cross(v, e), cross(u, e)
        twice, mixed = cross(v, once), cross(v, other) + cross(u, once)
        return first * other + second * mixed + slope * (first_slope * once + second_slope * twice)

    return _columns_of(column, v)


@of_arrays
def right_jacobian(v: Vec3) -> Mat3:
    """Return the right Jacobian (..., 3, 3) of SO(3) at the rotation vector `v` (..., 3) [rad].

    It maps the rate v̇ [rad/s] to the angular rate [rad/s] in body axes, and is the transpose of `left_jacobian`.
    """
    return left_jacobian(-v)


@of_arrays
def left_jacobian_inverse(v: Vec3, w: Vec3) -> Vec3:
    """Return J⁻¹w (..., 3) with the left Jacobian J at the rotation vector `v` (..., 3) [rad], |v| < 2π.

    J⁻¹ = E − ½ [v×] + (1 − θ/2 cot θ/2)/θ² [v×]².
    """
    x = dot(v, v)
    small, near, angle = _split(x)
    series = [b / math.factorial(2 * k) for k, b in enumerate(BERNOULLI, 1)]
    second = xp.where(small, horner(series, near), (1 - 0.5 * angle / xp.tan(0.5 * angle)) / angle**2)
    once = cross(v, w)
    return w - 0.5 * once + second[..., None] * cross(v, once)


def _columns_of(column: Callable[[Vec3], Vec3], v: Vec3) -> Mat3:
    """Return the matrix with the columns `column(e)` of the three unit vectors e."""
    return xp.stack([column(xp.broadcast_to(e, v.shape)) for e in np.eye(3, dtype=v.dtype)], axis=-1)


def _coefficients(x: Scalar) -> list[Any]:
    """Return (1 − cos θ)/θ² and (θ − sin θ)/θ³ at x = θ², with a last axis of length 1."""
    small, near, angle = _split(x)
    far = (1 - xp.cos(angle)) / angle**2, (angle - xp.sin(angle)) / angle**3
    return [xp.where(small, horner(SERIES[m], near), y)[..., None] for m, y in zip(SERIES, far, strict=True)]


def _coefficient_slopes(x: Scalar) -> list[Any]:
    """Return the derivatives of `_coefficients` with respect to x, with a last axis of length 1."""
    small, near, angle = _split(x)
    rest, excess = 1 - xp.cos(angle), angle - xp.sin(angle)
    far = (angle * xp.sin(angle) - 2 * rest) / (2 * angle**4), (angle * rest - 3 * excess) / (2 * angle**5)
    slopes = [[k * c for k, c in enumerate(series)][1:] for series in SERIES.values()]
    return [xp.where(small, horner(series, near), y)[..., None] for series, y in zip(slopes, far, strict=True)]


def _split(x: Scalar) -> tuple[Any, Any, Any]:
    """Return whether x = θ² is small, safe arguments x of series, and safe angles θ of closed forms."""
    small = x < SMALL_SQUARE
    return small, xp.where(small, x, 0.0), xp.sqrt(xp.where(small, 1.0, x))


@of_arrays
def euler_rates_to_body(seq: str, angles: Vec3, rates: Vec3) -> Vec3:
    """Return the angular rate (..., 3) [rad/s] in body axes, from Euler `angles` [rad] and their `rates` [rad/s].

    The angles and rates (..., 3) are in the order of `seq`, as in `from_euler`.

    **Raises:** ValueError for an invalid `seq`.
    """
    angles, rates = xp.broadcast_arrays(angles, rates)
    columns = _columns(seq, angles)
    return sum((column * rates[..., k : k + 1] for k, column in enumerate(columns)), xp.zeros_like(columns[0]))


def body_to_euler_rates(seq: str, angles: Any, omega: Any) -> Vec3:
    """Return the rates (..., 3) [rad/s] of Euler `angles` [rad] at the angular rate `omega` [rad/s] in body axes.

    The inverse of `euler_rates_to_body`. In gimbal lock, where the second angle is 0 or ±π for sequences such as zxz,
    and ±π/2 for sequences such as ZYX, the rates do not exist; inside a trace they are then NaN.

    **Raises:** ValueError for an invalid `seq`, and for concrete angles in gimbal lock.
    """
    rates, determinant = _solved(seq, angles, omega)
    locked = abs(determinant) <= LOCK * float(xp.finfo(determinant.dtype).eps)
    if is_traced(locked):
        return xp.where(locked[..., None], np.nan, rates)
    if np.any(np.asarray(locked)):
        at = tuple(int(k) for k in np.argwhere(np.asarray(locked))[0])
        where = f" (element {', '.join(map(str, at))})" if at else ""
        raise ValueError(
            f"the Euler angles {seq!r}{where} are in gimbal lock, where their rates do not exist: use another "
            "sequence, or quaternions"
        )
    return rates


@of_arrays
def _solved(seq: str, angles: Vec3, omega: Vec3) -> tuple[Vec3, Scalar]:
    """Return the rates of the angles by Cramer's rule, and the determinant."""
    angles, omega = xp.broadcast_arrays(angles, omega)
    a, b, c = _columns(seq, angles)
    normals = cross(b, c), cross(c, a), cross(a, b)
    determinant = dot(a, normals[0])
    safe = xp.where(determinant == 0, 1.0, determinant)
    return xp.stack([dot(normal, omega) / safe for normal in normals], axis=-1), determinant


def _columns(seq: str, angles: Vec3) -> list[Vec3]:
    """Return the axes of the three rotations of a sequence in body axes, in the order of the angles."""
    axes, intrinsic = parse(seq)
    order = [0, 1, 2] if intrinsic else [2, 1, 0]  # from the inertial axes to the body axes
    after, columns = None, {}
    for k in reversed(order):
        q = turn(axes[k], angles[..., k])
        e = xp.broadcast_to(np.eye(3, dtype=angles.dtype)[axes[k]], angles.shape)
        columns[k] = e if after is None else rotate(conjugate(after), e)
        after = q if after is None else product(q, after)
    return [columns[k] for k in range(3)]
