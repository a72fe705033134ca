"""Compute the C² rotation spline: cubic rotation vectors between attitudes, with continuous angular acceleration.

Between two attitudes, λ(t) = λ_i∘exp(θ(t)/2), where θ is a cubic with θ(0) = 0. The rate is ω = M(θ)θ̇ in body axes
with

    M = E − c₂[θ×] + c₃[θ×]²,   M⁻¹ = E + ½[θ×] + (c₃ − 2c₄)/(2c₂) [θ×]²,   c_m = Σ_k (−x)^k/(2k+m)!,  x = |θ|².

E is the identity matrix, and [θ×] the matrix of the cross product with θ. The rates at the inner attitudes follow from
the continuity of the acceleration. They are computed by Newton's method with a block tridiagonal matrix. The rates at
both ends are the mean rates of the first and the last interval. The spline is the same as SciPy's RotationSpline, if
SciPy's iteration has converged; SciPy stops it after ten iterations.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.namespace import is_host, matmul, repeat, stop_gradient, xp
from qtraj.foundation.types import Mat3, Scalar, Vec3

TERMS = 16
"""Number of terms of the series c_m, a power of two; the series are exact to round-off up to |θ| = 2π."""

MAX_ITERATIONS = 50
"""Maximum number of Newton iterations; usually about five are needed."""

EXACT_ORDERS = 2
"""The order up to which derivatives of the rates with respect to the table are exact."""

COEFFICIENTS = [[[(-1) ** k / math.factorial(2 * k + m)] for k in range(TERMS)] for m in (3, 4, 5)]
"""The coefficients (TERMS, 1) of c₃, c₄ and c₅ in ascending powers of x."""

Vectors = Float[Array, "*batch 3"]
Blocks = Float[Array, "_ 3 3"]
Widths = Float[Array, " _"]


def rate(theta: Vectors, slope: Vectors) -> Vectors:
    """Return the rate ω = M(θ)θ̇ [rad/s] of λ∘exp(θ/2) with constant λ, body axes; `slope` is θ̇ [rad/s]."""
    two, three, *_ = _stumpff(theta)
    cross = xp.cross(theta, slope)
    return slope - two * cross + three * xp.cross(theta, cross)


def acceleration(theta: Vectors, slope: Vectors, second: Vectors) -> Vectors:
    """Return the acceleration ε = M(θ)θ̈ + (∂M/∂θ·θ̇)θ̇ [rad/s²], body axes; `second` is θ̈ [rad/s²]."""
    return rate(theta, second) + _change(theta, slope, slope)


def slope(theta: Vectors, omega: Vectors) -> Vectors:
    """Return θ̇ = M(θ)⁻¹ω [rad/s]; for |θ| ≤ 2π, the matrix M is singular only at |θ| = 2π."""
    two, three, four, _ = _stumpff(theta)
    cross = xp.cross(theta, omega)
    return omega + cross / 2 + (three - 2 * four) / (2 * two) * xp.cross(theta, cross)


def cubic(rotation: Vec3, width: Scalar, first: Vec3, last: Vec3) -> Float[Array, "4 3"]:
    """Return the coefficients (4, 3) of θ(t) on an interval of `width` [s], lowest power first.

    `rotation` is the rotation vector of the interval; `first` and `last` [rad/s] are the rates at its start and its
    end.
    """
    end = slope(rotation, last)
    mean = rotation / width
    return xp.stack(
        [xp.zeros_like(rotation), first, (3 * mean - 2 * first - end) / width, (first + end - 2 * mean) / width**2]
    )


def knot_rates(rotations: Float[Array, "n 3"], widths: Widths) -> tuple[Float[Array, "n+1 3"], Scalar]:
    """Return the rates at all attitudes (n+1, 3) [rad/s], and the largest remaining jump of the acceleration [rad/s²].

    `rotations` (n, 3): the rotation vectors between neighbouring attitudes; `widths` (n,) [s]: the time intervals.
    """
    means = rotations / widths[:, None]
    if rotations.shape[0] == 1:
        return xp.concatenate([means, means]), xp.zeros_like(widths[0])
    conditions = _conditions(rotations, widths)
    fixed = stop_gradient(conditions)
    solution, middle = _solve_rates(fixed, stop_gradient(means))

    # Newton's iteration is not differentiated. Instead, each of the following steps with a constant matrix makes one
    # more order of derivatives exact.
    def correct(state: tuple[Any, Any]) -> tuple[Any, Any]:
        rates, _ = state
        jumps = _jumps(conditions, rates)
        inner = rates[1:-1] - _solve(fixed.before, middle, fixed.after, jumps)
        return xp.concatenate([means[:1], inner, means[-1:]]), xp.max(abs(jumps))

    start = xp.concatenate([means[:1], solution, means[-1:]]), xp.zeros_like(widths[0])
    return repeat(EXACT_ORDERS, correct, start)


class _Conditions(NamedTuple):
    """The jumps of the acceleration ε at the inner attitudes, the values before an attitude minus the values after.

    The intervals before and after an attitude have the rotation vectors Θ₀ and Θ₁ and the lengths h₀ and h₁ [s]. Let b
    be the rate at the attitude, a and c the rates at the previous and the next attitude, M₀ = M(Θ₀), M₁ = M(Θ₁) and
    e = M₀⁻¹ b. The jump is
    (2/h₀) M₀ a + (4/h₀ + 4/h₁) b + (2/h₁) M₁⁻¹ c + (∂M₀/∂θ·e) e − 6 (Θ₀/h₀² + Θ₁/h₁²).
    """

    before: Blocks
    at: Float[Array, "_ 1"]
    after: Blocks
    constant: Float[Array, "_ 3"]
    rotation: Float[Array, "_ 3"]
    inverse: Blocks
    """The matrices M₀⁻¹."""


def _conditions(rotations: Float[Array, "n 3"], widths: Widths) -> _Conditions:
    first, second = rotations[:-1], rotations[1:]
    width, following = widths[:-1, None], widths[1:, None]
    return _Conditions(
        before=2 / width[..., None] * _matrices(rate, first),
        at=4 / width + 4 / following,
        after=2 / following[..., None] * _matrices(slope, second),
        constant=-6 * (first / width**2 + second / following**2),
        rotation=first,
        inverse=_matrices(slope, first),
    )


def _matrices(function: Callable[[Vectors, Vectors], Vectors], rotations: Float[Array, "_ 3"]) -> Blocks:
    """Return the matrices of a function that is linear in its second argument."""
    basis = np.eye(3, dtype=rotations.dtype)
    return xp.stack([function(rotations, xp.broadcast_to(e, rotations.shape)) for e in basis], axis=-1)


def _jumps(conditions: _Conditions, rates: Float[Array, "n 3"]) -> Float[Array, "_ 3"]:
    e = _times(conditions.inverse, rates[1:-1])
    linear = _times(conditions.before, rates[:-2]) + conditions.at * rates[1:-1] + _times(conditions.after, rates[2:])
    return linear + _change(conditions.rotation, e, e) + conditions.constant


def _slopes_at(conditions: _Conditions, rates: Float[Array, "_ 3"]) -> Blocks:
    """Return the derivatives of the jumps with respect to the rates at the same attitudes."""
    e = _times(conditions.inverse, rates)

    def change(theta: Vectors, direction: Vectors) -> Vectors:
        return _change(theta, e, direction) + _change(theta, direction, e)

    nonlinear = matmul(_matrices(change, conditions.rotation), conditions.inverse)
    return conditions.at[..., None] * np.eye(3, dtype=rates.dtype)[None] + nonlinear


def _change(theta: Vectors, a: Vectors, b: Vectors) -> Vectors:
    """Return (∂M/∂θ·a) b."""
    two, three, four, five = _stumpff(theta)
    along = xp.sum(theta * a, axis=-1, keepdims=True)
    cross = xp.cross(theta, b)
    # The derivative of c_m with respect to x is (m c_{m+2} − c_{m+1})/2, and that of x is 2θ·a.
    varied = (3 * five - four) * xp.cross(theta, cross) - (2 * four - three) * cross
    turned = xp.cross(a, cross) + xp.cross(theta, xp.cross(a, b))
    return along * varied + three * turned - two * xp.cross(a, b)


def _times(matrices: Blocks, vectors: Float[Array, "_ 3"]) -> Float[Array, "_ 3"]:
    return matmul(matrices, vectors[..., None])[..., 0]


class _State(NamedTuple):
    """Newton's iteration: the rates, the diagonal blocks of the Jacobian, the last change, and the number of steps."""

    rates: Float[Array, "n 3"]
    middle: Blocks
    change: Scalar
    count: Any


def _solve_rates(conditions: _Conditions, means: Float[Array, "n 3"]) -> tuple[Float[Array, "_ 3"], Blocks]:
    """Compute the inner rates by Newton's method, and return them with the diagonal blocks of the last Jacobian."""

    def improve(state: _State) -> _State:
        rates = state.rates
        middle = _slopes_at(conditions, rates[1:-1])
        change = _solve(conditions.before, middle, conditions.after, _jumps(conditions, rates))
        rates = xp.concatenate([rates[:1], rates[1:-1] - change, rates[-1:]])
        return _State(rates, middle, xp.max(abs(change)), state.count + 1)

    def unfinished(state: _State) -> Any:
        tolerance = 64 * float(jnp.finfo(state.rates.dtype).eps)
        return (state.count < MAX_ITERATIONS) & (state.change > tolerance * xp.max(abs(state.rates)))

    guess = xp.concatenate([means[:1], (means[1:] + means[:-1]) / 2, means[-1:]])
    state = _State(guess, xp.zeros_like(conditions.before), xp.full_like(means[0, 0], np.inf), 0)
    if is_host(guess):
        while unfinished(state):
            state = improve(state)
    else:
        state = jax.lax.while_loop(unfinished, improve, state)
    return stop_gradient(state.rates[1:-1]), stop_gradient(state.middle)


def _solve(lower: Any, middle: Any, upper: Any, right: Any) -> Any:
    """Solve a block tridiagonal system with 3×3 blocks (_, 3, 3) for the right-hand side (_, 3).

    The first block of `lower` and the last block of `upper` are not used.
    """
    return (_solve_banded if is_host(middle, right) else _eliminated)(lower, middle, upper, right)


def _solve_banded(lower: np.ndarray, middle: np.ndarray, upper: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve the system by LAPACK; the solution is NaN if it is singular or not finite."""
    from scipy.linalg import LinAlgError, solve_banded  # SciPy is not imported with the package

    n = 3 * len(right)
    bands = np.zeros((11, n))
    for offset, blocks, first in ((0, middle, 0), (-3, lower[1:], 3), (3, upper[:-1], 0)):
        for i in range(3):
            for j in range(3):
                count, column = len(blocks), first + j + offset
                bands[5 + i - j - offset, column : column + 3 * count : 3] = blocks[:, i, j]
    try:
        return solve_banded((5, 5), bands, right.ravel(), check_finite=True).reshape(-1, 3)
    except (LinAlgError, ValueError):
        return np.full_like(right, np.nan)


def _eliminated(lower: Blocks, middle: Blocks, upper: Blocks, right: Float[Array, "_ 3"]) -> Float[Array, "_ 3"]:
    """Solve the system by Gaussian elimination, compiled."""

    def down(state: tuple[Mat3, Vec3], row: tuple[Mat3, Mat3, Mat3, Vec3]) -> tuple[tuple[Mat3, Vec3], tuple]:
        factor, previous = state
        below, diagonal, above, value = row
        inverse = _inverse(diagonal - below @ factor)
        state = (inverse @ above, inverse @ (value - below @ previous))
        return state, state

    def up(after: Vec3, row: tuple[Mat3, Vec3]) -> tuple[Vec3, Vec3]:
        factor, value = row
        solution = value - factor @ after
        return solution, solution

    zero = jnp.zeros_like(right[0])
    lower = lower.at[0].set(0.0)
    upper = upper.at[-1].set(0.0)
    _, rows = jax.lax.scan(down, (jnp.zeros_like(middle[0]), zero), (lower, middle, upper, right))
    return jax.lax.scan(up, zero, rows, reverse=True)[1]


def _inverse(m: Mat3) -> Mat3:
    """Return the inverse, computed by cross products: fast to compile, and accurate for well-conditioned blocks."""
    cofactors = jnp.stack([jnp.cross(m[1], m[2]), jnp.cross(m[2], m[0]), jnp.cross(m[0], m[1])])
    return cofactors.T / (m[0] @ cofactors[0])


def _stumpff(theta: Vectors) -> tuple[Any, Any, Any, Any]:
    """Return the Stumpff functions c₂ to c₅ of x = |θ|² with a last axis of length 1; c₂ is computed as ½ − x c₄."""
    x = xp.sum(theta * theta, axis=-1, keepdims=True)
    powers = xp.concatenate([xp.ones_like(x), x], axis=-1)
    while powers.shape[-1] < TERMS:
        powers = xp.concatenate([powers, powers * (powers[..., -1:] * x)], axis=-1)
    three, four, five = (matmul(powers, np.asarray(column, x.dtype)) for column in COEFFICIENTS)
    return 0.5 - x * four, three, four, five
