"""Limits on a spiral-helix as polynomial inequalities in u = t/duration (paper S; every derivative is a polynomial).

In the rotating basis the derivatives of r = ρ e^{iφ} + k h follow from (a, b)' = (a' − bφ', b' + aφ'), starting with
(ρ, 0): polynomials for polynomial ρ, φ, h. So value² = numerator/denominator, and a limit holds where limit² ·
denominator − numerator ≥ 0 and the denominator is positive. Time is counted in durations and lengths in a power of two
near the size of the path, so that nothing overflows at high degrees.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.bernstein import Bernstein, constant, cross, dot, from_ascending, stacked
from qtraj.foundation.types import Flag, Scalar, ScalarLike
from qtraj.path.spiral_helix import SpiralHelix

Ratio = tuple[Bernstein, Bernstein]

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


def parts(path: SpiralHelix, order: int) -> Parts:
    """The first `order` derivatives of a path."""
    # Where height and azimuth begin does not count, and must not coarsen what does.
    coefficients = path.radius, path.angle.at[0].set(0.0), path.height.at[0].set(0.0)
    powers = [_in_durations(c, path.duration) for c in coefficients]
    length = _power_of_two(jnp.max(jnp.abs(jnp.concatenate([powers[0], powers[2]]))))
    radius, angle, height = (from_ascending(c, _rounding(c, path.duration)) for c in powers)
    turning = angle.derivative()
    a, h = radius.scaled(1 / length), height.scaled(1 / length).derivative()
    a, b = a.derivative(), a * turning
    derivatives = [stacked(a, b, h)]
    for _ in range(order - 1):
        a, b, h = a.derivative() - b * turning, b.derivative() + a * turning, h.derivative()
        derivatives.append(stacked(a, b, h))
    return Parts(derivatives, length, path.duration)


class Form(NamedTuple):
    """Of one limited magnitude: how many derivatives it needs, its square as a ratio, and its unit m^length s^−time.

    `divisor`: what the square divides by, S of "motion" or N of "bend"; nothing for None.
    """

    order: int
    ratio: Callable[[list[Bernstein]], Ratio]
    divisor: str | None
    length: int
    time: int


def slack(parts: Parts, limit: Scalar, form: Form, low: ScalarLike, high: ScalarLike) -> Bernstein:
    """limit² · denominator − numerator on a part of [0, 1]: the limit holds where this is not negative."""
    numerator, denominator = form.ratio(parts.on(low, high))
    scaled = limit * parts.length**-form.length
    bound = scaled * parts.duration**form.time
    normal = _normal(scaled) & _normal(bound) & _normal(bound**2)
    rounding = jnp.where(normal, 16 * float(jnp.finfo(bound.dtype).eps) * bound**2, jnp.inf)
    return denominator.scaled(bound**2, rounding) - numerator


def divisor(parts: Parts, which: str, low: ScalarLike, high: ScalarLike) -> Bernstein:
    """S of "motion" or N of "bend" on a part of [0, 1]: what magnitudes divide by."""
    r = parts.on(low, high)
    return _square(r[0]) if which == "motion" else _square(cross(r[0], r[1]))


def _square(v: Bernstein) -> Bernstein:
    return dot(v, v)


def _one(like: Bernstein) -> Bernstein:
    return constant(jnp.ones_like(like.error))


def _speed(r: list[Bernstein]) -> Ratio:
    S = _square(r[0])
    return S, _one(S)


def _acceleration(r: list[Bernstein]) -> Ratio:
    square = _square(r[1])
    return square, _one(square)


def _lateral(r: list[Bernstein]) -> Ratio:
    return _square(cross(r[0], r[1])), _square(r[0])


def _longitudinal(r: list[Bernstein]) -> Ratio:
    along = dot(r[0], r[1])
    return along * along, _square(r[0])


def _slope(r: list[Bernstein]) -> Ratio:
    square = r[0] * r[0]
    return square[2], square[0] + square[1]


def _curvature(r: list[Bernstein]) -> Ratio:
    S = _square(r[0])
    return _square(cross(r[0], r[1])), S * S * S


def _torsion(r: list[Bernstein]) -> Ratio:
    c = cross(r[0], r[1])
    N, T = dot(c, c), dot(c, r[2])
    return T * T, N * N


def _angular_rate(r: list[Bernstein]) -> Ratio:
    c = cross(r[0], r[1])
    S, N, T = _square(r[0]), dot(c, c), dot(c, r[2])
    NS = N * S
    return S * (S * T) * (S * T) + N * (N * N), NS * NS


def _angular_acceleration(r: list[Bernstein]) -> Ratio:
    """ε⁰ = (v'χ + vχ', 0, q/(|c|S) − 2|c|B/S²) with χ = T/N, q = c·c', B = r'·r'' (THEORY: section 3)."""
    c, c1 = cross(r[0], r[1]), cross(r[0], r[2])
    S, N, T = _square(r[0]), dot(c, c), dot(c, r[2])
    B, q, D = dot(r[0], r[1]), dot(c, c1), dot(c, r[3])
    twist = B * (T * N) + S * (D * N - (T * q).scaled(2))
    bend = q * S - (N * B).scaled(2)
    S2, N2 = S * S, N * N
    return S * S2 * (twist * twist) + N * N2 * (bend * bend), (S2 * S2) * (N2 * N2)


FORMS = {
    "curvature": Form(2, _curvature, "motion", -1, 0),
    "torsion": Form(3, _torsion, "bend", -1, 0),
    "speed": Form(1, _speed, None, 1, 1),
    "acceleration": Form(2, _acceleration, None, 1, 2),
    "lateral_acceleration": Form(2, _lateral, "motion", 1, 2),
    "longitudinal_acceleration": Form(2, _longitudinal, "motion", 1, 2),
    "slope": Form(1, _slope, "motion", 0, 0),
    "angular_rate": Form(3, _angular_rate, "bend", 0, 1),
    "angular_acceleration": Form(4, _angular_acceleration, "bend", 0, 2),
}
"""Of each field of `Limits`."""


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
