"""Limits as polynomial inequalities in u = t/duration (paper S; in the moving basis every derivative is a polynomial).

The derivatives of R_z(φ)·(a, b, h) follow from (a, b)' = (a' − bφ', b' + aφ'). So a quantity's square is
numerator/denominator, and a limit holds where limit² · denominator − numerator ≥ 0 and the divisor is positive. Time is
counted in durations and lengths in a power of two near the size of the path, so that nothing overflows at high degrees.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.bernstein import Bernstein, constant, from_ascending, stacked
from qtraj.foundation.types import Flag, Scalar, ScalarLike
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import PathQuantity

HIGHEST_DEGREE = 72
"""Of an inequality that is proved: the angular acceleration of a uniform cubic. Higher ones are sampled."""


class Parts(eqx.Module):
    """The derivatives r', r'', … of a path in u, in the rotating basis and in units of `length` [m]."""

    derivatives: list[Bernstein]
    length: Scalar
    duration: Scalar

    def on(self, low: ScalarLike, high: ScalarLike) -> list[Bernstein]:
        """The derivatives on a part of [0, 1]."""
        return [r.on(low, high) for r in self.derivatives]


def parts(path: MovingPolynomials, duration: Scalar, order: int) -> Parts:
    """The first `order` derivatives of a path."""
    # Where height and azimuth begin does not count, and must not coarsen what does.
    given = [path.x, jnp.zeros_like(path.x[:1]) if path.y is None else path.y, path.z.at[0].set(0.0)]
    powers = [_in_durations(c, duration) for c in (*given, path.angle.at[0].set(0.0))]
    length = _power_of_two(jnp.max(jnp.abs(jnp.concatenate(powers[:3]))))
    x, y, z, angle = (from_ascending(c, _rounding(c, duration)) for c in powers)
    turning = angle.derivative()
    a, b, h = (c.scaled(1 / length) for c in (x, y, z))
    derivatives = []
    for _ in range(order):
        a, b, h = a.derivative() - b * turning, b.derivative() + a * turning, h.derivative()
        derivatives.append(stacked(a, b, h))
    return Parts(derivatives, length, duration)


def slack(parts: Parts, limit: Scalar, entry: PathQuantity, low: ScalarLike, high: ScalarLike) -> Bernstein:
    """limit² · denominator − numerator on a part of [0, 1]: the limit holds where this is not negative."""
    i = invariants_on(parts, low, high)
    numerator = entry.numerator(i)
    denominator = constant(jnp.ones_like(numerator.error)) if entry.denominator is None else entry.denominator(i)
    scaled = limit * parts.length**-entry.length
    bound = scaled * parts.duration**entry.per_time
    normal = _normal(scaled) & _normal(bound) & _normal(bound**2)
    rounding = jnp.where(normal, 16 * float(jnp.finfo(bound.dtype).eps) * bound**2, jnp.inf)
    return denominator.scaled(bound**2, rounding) - numerator


def divisor(parts: Parts, which: str, low: ScalarLike, high: ScalarLike) -> Bernstein:
    """What quantities divide by, on a part of [0, 1]: S of "speed", N of "cross_norm", H of "level"."""
    i = invariants_on(parts, low, high)
    return {"speed": lambda: i.S, "cross_norm": lambda: i.N, "level": lambda: i.H}[which]()


def invariants_on(parts: Parts, low: ScalarLike, high: ScalarLike) -> Invariants:
    """The invariants as polynomials on a part of [0, 1]."""
    return Invariants([None, *parts.on(low, high)])


def _in_durations(coefficients: Float[Array, " n"], duration: Scalar) -> Float[Array, " n"]:
    """Coefficients in u = t/duration."""
    powers = [jnp.ones_like(duration)]
    for _ in range(coefficients.shape[0] - 1):
        powers.append(powers[-1] * duration)
    return coefficients * jnp.stack(powers)


def _rounding(coefficients: Float[Array, " n"], duration: Scalar) -> Scalar:
    """What forming the coefficients in u may have done to any of them; infinite where a power left the normal range."""
    count = coefficients.shape[0]
    relative = count * float(jnp.finfo(coefficients.dtype).eps)
    normal = _normal(duration ** (count - 1)) & _normal(duration)
    return jnp.where(normal, relative * jnp.max(jnp.abs(coefficients)), jnp.inf)


def _normal(x: Scalar) -> Flag:
    """Whether a positive number is far from overflow and underflow, so that its rounding is relative."""
    limits = jnp.finfo(x.dtype)
    return (x > float(limits.tiny) / float(limits.eps)) & (x < float(limits.max) * float(limits.eps))


def _power_of_two(size: Scalar) -> Scalar:
    positive = (size > 0) & jnp.isfinite(size)
    _, exponent = jnp.frexp(jnp.where(positive, size, 1.0))
    return jnp.ldexp(jnp.ones_like(size), exponent)
