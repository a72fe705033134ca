"""Cubic-spline profiles: slews in a fixed time with the smallest ∫Φ̈² dt under limits on rate and acceleration.

Paper C proposes cubic splines Φ(t) where the time T and both limits are given. Among all slews from rest to rest with
|Φ̇| ≤ V and |Φ̈| ≤ A, the one with the smallest ∫Φ̈² dt is a cubic spline: Φ̈ is A for a time s, falls linearly to 0 in
a time d, is 0 for 2c, and the same backwards (the minimum principle: where no limit is active, Φ̈ is linear, and it has
no jump where Φ̇ reaches V). With Φ the angle and T = 2(s + d + c):

| active       | d                          | s          | first acceleration |
|--------------|----------------------------|------------|--------------------|
| none         | T/2: one cubic             | 0          | 6Φ/T²              |
| rate         | 3/2 (T − Φ/V)              | 0          | 2V/d               |
| acceleration | √(3(T²/4 − Φ/A))           | T/2 − d    | A                  |
| both         | √(12(VT − V²/A − Φ)/A)     | V/A − d/2  | A                  |

At the minimum time d = 0: the time-optimal slew.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.profiles.profile import AbstractProfile, Profile, fixed_duration, limit, nonzero_size, require_limits

STEEPEST = 1e-6
"""With a rate limit alone the minimum time is Φ/V plus this fraction: the acceleration has no bound there."""


class _Half(eqx.Module):
    """The first half of a slew: times s and d [s], and the first acceleration [rad/s²]."""

    steady: Scalar
    falling: Scalar
    acceleration: Scalar


@storable
class CubicSpline(AbstractProfile):
    """The slew in `duration` [s] with the smallest ∫Φ̈² dt within `max_rate` [rad/s] and `max_acceleration` [rad/s²].

    A cubic spline with knots where a limit becomes active or inactive; a single cubic where none does. Rate and
    position are continuous, and so is the acceleration except at the ends, where it jumps like that of a `Cubic`. Every
    duration is possible from that of a `TimeOptimal` slew within the same limits on. At rest at both ends.

    **Raises:** ValueError for values that are not positive, or without a duration; in `profile` for a duration that is
    too short.
    """

    duration: Scalar | None
    max_rate: Scalar | None
    max_acceleration: Scalar | None
    name: ClassVar[str] = "cubic-spline"

    def __repr__(self) -> str:
        return shown(self, duration="s", max_rate="rad/s", max_acceleration="rad/s²")

    def __init__(
        self, duration: ArrayInput, max_rate: ArrayInput | None = None, max_acceleration: ArrayInput | None = None
    ):
        self.duration, self.max_rate = limit(duration), limit(max_rate)
        self.max_acceleration = limit(max_acceleration)
        if self.duration is None:
            raise ValueError(
                "a cubic-spline slew needs a duration [s]. Use TimeOptimal or SCurve for the shortest one."
            )
        require_limits(self)

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """The profile of a slew by `total` [rad], and the minimum duration [s] within the limits."""
        angle = nonzero_size(total)
        rate, acceleration = (
            None if x is None else x.astype(total.dtype) for x in (self.max_rate, self.max_acceleration)
        )
        minimal = _shortest(angle, rate, acceleration)
        asked = minimal if self.duration is None else self.duration.astype(total.dtype)
        duration, feasible = fixed_duration(asked, minimal)
        half = _gentlest(angle, duration, rate, acceleration)
        widths, pieces = _spline(half, duration)
        profile = Profile(
            total=total,
            duration=duration,
            starts=_starts(half, duration),
            widths=widths,
            pieces=pieces / angle,
            end_rate=jnp.zeros_like(total),
            feasible=feasible,
        )
        return profile, minimal


def _shortest(angle: Scalar, rate: Scalar | None, acceleration: Scalar | None) -> Scalar:
    """The minimum time [s]: that of the time-optimal slew."""
    if acceleration is None:
        return jnp.zeros_like(angle) if rate is None else angle / rate * (1 + STEEPEST)
    alone = 2 * jnp.sqrt(angle / acceleration)
    if rate is None:
        return alone
    return jnp.where(angle <= rate**2 / acceleration, alone, angle / rate + rate / acceleration)


def _gentlest(angle: Scalar, duration: Scalar, rate: Scalar | None, acceleration: Scalar | None) -> _Half:
    """The first half with the smallest ∫Φ̈²: a limit is active if the optimum without it violates it."""
    half = _Half(jnp.zeros_like(angle), duration / 2, 6 * angle / duration**2)
    if acceleration is not None:
        falling = _root(3 * (duration**2 / 4 - angle / acceleration))
        half = _chosen(half.acceleration > acceleration, _Half(duration / 2 - falling, falling, acceleration), half)
    if rate is None:
        return half
    fast = half.acceleration * (half.steady + half.falling / 2) > rate
    falling = 1.5 * (duration - angle / rate)
    safe = jnp.where(fast, falling, 1.0)
    coasting = _Half(jnp.zeros_like(angle), falling, 2 * rate / safe)
    if acceleration is not None:
        both = _root(12 * (rate * duration - rate**2 / acceleration - angle) / acceleration)
        limited = _Half(jnp.maximum(rate / acceleration - both / 2, 0.0), both, acceleration)
        coasting = _chosen(coasting.acceleration > acceleration, limited, coasting)
    return _chosen(fast, coasting, half)


def _spline(half: _Half, duration: Scalar) -> tuple[Scalar, Scalar]:
    """Widths (5,) and ascending coefficients (5, 4) of the angle [rad] in each piece's own u."""
    s, d, a = half.steady, half.falling, half.acceleration
    coast = jnp.maximum(duration - 2 * (s + d), 0.0)
    widths = jnp.stack([s, d, coast, d, s])
    zero = jnp.zeros_like(a)
    first = jnp.stack([a, a, zero, zero, -a])  # accelerations at the start of each piece, and what they gain in it
    gained = jnp.stack([zero, -a, zero, -a, zero])
    risen = (first + gained / 2) * widths
    rates = jnp.cumsum(risen) - risen
    powers = jnp.stack([rates * widths, first * widths**2 / 2, gained * widths**2 / 6], axis=1)
    turned = jnp.sum(powers, axis=1)
    angles = jnp.cumsum(turned) - turned
    return widths, jnp.concatenate([angles[:, None], powers], axis=1)


def _starts(half: _Half, duration: Scalar) -> Scalar:
    s, d = half.steady, half.falling
    return jnp.stack([jnp.zeros_like(s), s, s + d, duration - s - d, duration - s])


def _chosen(condition: Scalar, a: _Half, b: _Half) -> _Half:
    return _Half(
        jnp.where(condition, a.steady, b.steady),
        jnp.where(condition, a.falling, b.falling),
        jnp.where(condition, a.acceleration, b.acceleration),
    )


def _root(x: Scalar) -> Scalar:
    """√x, and 0 with zero gradient for x ≤ 0."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)
