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
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.types import Mat3, Scalar, Vec3

TERMS = 16
"""Number of terms of the series c_m, a power of two; the series are exact to round-off up to |θ| = 2π."""

MAX_ITERATIONS = 50
"""Maximum number of Newton iterations; usually about five are needed."""

EXACT_ORDERS = 2
"""The order up to which derivatives of the rates with respect to the table are exact."""

Vectors = Float[Array, "_ 3"]
Blocks = Float[Array, "_ 3 3"]
Widths = Float[Array, " _"]
_State = tuple[Array, Array, Array, Any]


def rate(theta: Vec3, slope: Vec3) -> Vec3:
    """Return the rate ω = M(θ)θ̇ [rad/s] of λ∘exp(θ/2) with constant λ, body axes; `slope` is θ̇ [rad/s]."""
    two, three, _ = _stumpff(theta @ theta)
    cross = jnp.cross(theta, slope)
    return slope - two * cross + three * jnp.cross(theta, cross)


def slope(theta: Vec3, omega: Vec3) -> Vec3:
    """Return θ̇ = M(θ)⁻¹ω [rad/s]; for |θ| ≤ 2π, the matrix M is singular only at |θ| = 2π."""
    two, three, four = _stumpff(theta @ theta)
    cross = jnp.cross(theta, omega)
    return omega + cross / 2 + (three - 2 * four) / (2 * two) * jnp.cross(theta, cross)


def cubic(rotation: Vec3, width: Scalar, first: Vec3, last: Vec3) -> Float[Array, "4 3"]:
    """Return the coefficients (4, 3) of θ(t) on an interval of `width` [s], lowest power first.

    `rotation` is the rotation vector of the interval; `first` and `last` [rad/s] are the rates at its start and its
    end.
    """
    end = slope(rotation, last)
    mean = rotation / width
    return jnp.stack(
        [jnp.zeros_like(rotation), first, (3 * mean - 2 * first - end) / width, (first + end - 2 * mean) / width**2]
    )


def knot_rates(rotations: Vectors, widths: Widths) -> tuple[Vectors, Scalar]:
    """Return the rates at all attitudes (n+1, 3) [rad/s], and the largest remaining jump of the acceleration [rad/s²].

    `rotations` (n, 3): the rotation vectors between neighbouring attitudes; `widths` (n,) [s]: the time intervals.
    """
    means = rotations / widths[:, None]
    if rotations.shape[0] == 1:
        return jnp.concatenate([means, means]), jnp.zeros_like(widths[0])
    conditions = jax.vmap(_Condition.between)(rotations[:-1], rotations[1:], widths[:-1], widths[1:])
    fixed = stop_gradient(conditions)
    solution, middle = _solve_rates(fixed, stop_gradient(means))

    # Newton's iteration is not differentiated. Instead, each of the following steps with a constant matrix makes one
    # more order of derivatives exact.
    def correct(rates: Vectors, _: None) -> tuple[Vectors, Scalar]:
        jumps = _jumps(conditions, rates)
        inner = rates[1:-1] - _solve(fixed.before, middle, fixed.after, jumps)
        return jnp.concatenate([means[:1], inner, means[-1:]]), jnp.max(jnp.abs(jumps))

    rates, jumps = jax.lax.scan(correct, jnp.concatenate([means[:1], solution, means[-1:]]), length=EXACT_ORDERS)
    return rates, jumps[-1]


class _Condition(eqx.Module):
    """The jump of the acceleration ε at an inner attitude, the value before the attitude minus the value after.

    The intervals before and after the attitude have the rotation vectors Θ₀ and Θ₁ and the lengths h₀ and h₁ [s]. Let b
    be the rate at the attitude, a and c the rates at the previous and the next attitude, M₀ = M(Θ₀), M₁ = M(Θ₁) and
    e = M₀⁻¹ b. The jump is
    (2/h₀) M₀ a + (4/h₀ + 4/h₁) b + (2/h₁) M₁⁻¹ c + (∂M₀/∂θ·e) e − 6 (Θ₀/h₀² + Θ₁/h₁²).
    """

    before: Mat3
    at: Scalar
    after: Mat3
    constant: Vec3
    rotation: Vec3

    @classmethod
    def between(cls, first: Vec3, second: Vec3, width: Scalar, next_width: Scalar) -> "_Condition":
        basis = jnp.eye(3, dtype=first.dtype)
        return cls(
            before=2 / width * jax.vmap(lambda e: rate(first, e), out_axes=1)(basis),
            at=4 / width + 4 / next_width,
            after=2 / next_width * jax.vmap(lambda e: slope(second, e), out_axes=1)(basis),
            constant=-6 * (first / width**2 + second / next_width**2),
            rotation=first,
        )

    def jump(self, a: Vec3, b: Vec3, c: Vec3) -> Vec3:
        return self.before @ a + self.at * b + self.after @ c + self.nonlinear(b) + self.constant

    def nonlinear(self, b: Vec3) -> Vec3:
        """Return the term of the jump that is not linear in the rates, (∂M₀/∂θ·e) e."""
        e = slope(self.rotation, b)
        return jax.jvp(lambda theta: rate(theta, e), (self.rotation,), (e,))[1]

    def middle(self, b: Vec3) -> Mat3:
        return self.at * jnp.eye(3, dtype=b.dtype) + jax.jacfwd(self.nonlinear)(b)


def _jumps(conditions: _Condition, rates: Vectors) -> Vectors:
    return jax.vmap(_Condition.jump)(conditions, rates[:-2], rates[1:-1], rates[2:])


def _solve_rates(conditions: _Condition, means: Vectors) -> tuple[Vectors, Blocks]:
    """Compute the inner rates by Newton's method, and return them with the diagonal blocks of the last Jacobian."""

    def improve(state: _State) -> _State:
        rates, _, _, count = state
        middle = jax.vmap(_Condition.middle)(conditions, rates[1:-1])
        change = _solve(conditions.before, middle, conditions.after, _jumps(conditions, rates))
        rates = jnp.concatenate([rates[:1], rates[1:-1] - change, rates[-1:]])
        return rates, middle, jnp.max(jnp.abs(change)), count + 1

    def unfinished(state: _State) -> Array:
        rates, _, change, count = state
        tolerance = 64 * float(jnp.finfo(rates.dtype).eps)
        return (count < MAX_ITERATIONS) & (change > tolerance * jnp.max(jnp.abs(rates)))

    guess = jnp.concatenate([means[:1], (means[1:] + means[:-1]) / 2, means[-1:]])
    start = (guess, jnp.zeros_like(conditions.before), jnp.full_like(means[0, 0], jnp.inf), 0)
    rates, middle, _, _ = jax.lax.while_loop(unfinished, improve, start)
    return stop_gradient(rates[1:-1]), stop_gradient(middle)


def _solve(lower: Blocks, middle: Blocks, upper: Blocks, right: Vectors) -> Vectors:
    """Solve a block tridiagonal system with 3×3 blocks by Gaussian elimination.

    The first block of `lower` and the last block of `upper` are not used.
    """

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


def _stumpff(x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Return the Stumpff functions c₂, c₃ and c₄ at `x`; c₂ is computed as ½ − x c₄."""
    powers = jnp.stack([jnp.ones_like(x), x])
    while powers.shape[0] < TERMS:
        powers = jnp.concatenate([powers, powers * (powers[-1] * x)])
    three, four = (
        powers @ jnp.asarray([(-1) ** k / math.factorial(2 * k + m) for k in range(TERMS)], x.dtype) for m in (3, 4)
    )
    return 0.5 - x * four, three, four
