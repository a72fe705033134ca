"""Compute multi-knot cubic profiles, which minimise ∫Φ̈² dt for a fixed duration within limits on rate and acceleration.

Paper C proposes cubic splines Φ(t) for a prescribed duration T and limits on rate and acceleration. Among all slews of
this duration from rest to rest with |Φ̇| ≤ V and |Φ̈| ≤ A, the slew with the smallest ∫Φ̈² dt is a cubic spline. In its
first half, Φ̈ keeps its initial value for a time s, decreases linearly to 0 in a time d, and is 0 for a time c; the
second half is antisymmetric. (By the minimum principle, Φ̈ is linear where no limit is active, and continuous where Φ̇
reaches V.) With the angle Φ and T = 2(s + d + c), the times and the initial acceleration are:

| active limit | d                          | s          | initial acceleration |
|--------------|----------------------------|------------|----------------------|
| none         | T/2 (a single cubic)       | 0          | 6Φ/T²                |
| rate         | 3/2 (T − Φ/V)              | 0          | 2V/d                 |
| acceleration | √(3(T²/4 − Φ/A))           | T/2 − d    | A                    |
| both         | √(12(VT − V²/A − Φ)/A)     | V/A − d/2  | A                    |

At the minimum time, d is 0 and the slew is time-optimal.
"""

from typing import ClassVar

import equinox as eqx

from qtraj.foundation.document import formerly, storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.profiles.profile import AbstractProfile, Profile, fixed_duration, limit, nonzero_size, require_limits

TIME_MARGIN = 1e-6
"""Fraction by which the minimum duration exceeds Φ/V if only the rate is limited; Φ̈ tends to infinity as T → Φ/V."""


class _Half(eqx.Module):
    """The first half of a slew: the times s and d [s], and the initial acceleration [rad/s²]."""

    constant: Scalar
    decreasing: Scalar
    acceleration: Scalar


@formerly("CubicSpline")
@storable
class MultiKnotCubic(AbstractProfile):
    """The profile with minimum ∫Φ̈² dt for a `duration` [s] and limits `max_rate` [rad/s], `max_acceleration` [rad/s²].

    The angle is a cubic spline with knots at the instants at which a limit becomes active or inactive, and a single
    cubic if no limit is active. The angle, rate and acceleration are continuous, except that the acceleration jumps at
    both ends, as in a `Cubic` profile. The slew starts and ends at rest. The minimum duration is the same as for a
    `TimeOptimal` slew within the same limits. For a distance along a line, read m instead of rad.

    **Raises:** ValueError for values that are not positive, or if the duration is missing. `profile` raises a
    ValueError if the duration is too short.
    """

    duration: Scalar | None
    max_rate: Scalar | None
    max_acceleration: Scalar | None
    name: ClassVar[str] = "multi-knot cubic"
    supports_numpy: ClassVar[bool] = True

    def __repr__(self) -> str:
        return shown(self, duration="s")  # the unit of the angle is the caller's

    def __init__(
        self, duration: ArrayInput, max_rate: ArrayInput | None = None, max_acceleration: ArrayInput | None = None
    ):
        self.duration, self.max_rate = limit(duration), limit(max_rate)
        self.max_acceleration = limit(max_acceleration)
        if self.duration is None:
            raise ValueError(
                "a multi-knot cubic slew needs a duration [s]. Use TimeOptimal or SCurve for the minimum duration."
            )
        require_limits(self)

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and the minimum duration [s] within the limits."""
        angle = nonzero_size(total)
        rate, acceleration = (
            None if x is None else x.astype(total.dtype) for x in (self.max_rate, self.max_acceleration)
        )
        minimal = _min_duration(angle, rate, acceleration)
        user_duration = minimal if self.duration is None else self.duration.astype(total.dtype)
        duration, feasible = fixed_duration(user_duration, minimal)
        half = _optimal_half(angle, duration, rate, acceleration)
        widths, pieces = _spline(half, duration)
        profile = Profile(
            total=total,
            duration=duration,
            starts=_starts(half, duration),
            widths=widths,
            pieces=pieces / angle,
            end_rate=xp.zeros_like(total),
            feasible=feasible,
        )
        return profile, minimal


def _min_duration(angle: Scalar, rate: Scalar | None, acceleration: Scalar | None) -> Scalar:
    """Return the minimum duration [s] within the limits, or 0 if there are no limits."""
    if acceleration is None:
        return xp.zeros_like(angle) if rate is None else angle / rate * (1 + TIME_MARGIN)
    without_rate_limit = 2 * xp.sqrt(angle / acceleration)
    if rate is None:
        return without_rate_limit
    return xp.where(angle <= rate**2 / acceleration, without_rate_limit, angle / rate + rate / acceleration)


def _optimal_half(angle: Scalar, duration: Scalar, rate: Scalar | None, acceleration: Scalar | None) -> _Half:
    """Return the first half of the optimal slew; a limit is active if the optimum without this limit violates it."""
    half = _Half(xp.zeros_like(angle), duration / 2, 6 * angle / duration**2)
    if acceleration is not None:
        decreasing = _root(3 * (duration**2 / 4 - angle / acceleration))
        limited = _Half(duration / 2 - decreasing, decreasing, acceleration)
        half = _where(half.acceleration > acceleration, limited, half)
    if rate is None:
        return half
    too_fast = half.acceleration * (half.constant + half.decreasing / 2) > rate
    decreasing = 1.5 * (duration - angle / rate)
    divisor = xp.where(too_fast, decreasing, 1.0)
    at_max_rate = _Half(xp.zeros_like(angle), decreasing, 2 * rate / divisor)
    if acceleration is not None:
        decreasing = _root(12 * (rate * duration - rate**2 / acceleration - angle) / acceleration)
        both_limits = _Half(xp.maximum(rate / acceleration - decreasing / 2, 0.0), decreasing, acceleration)
        at_max_rate = _where(at_max_rate.acceleration > acceleration, both_limits, at_max_rate)
    return _where(too_fast, at_max_rate, half)


def _spline(half: _Half, duration: Scalar) -> tuple[Scalar, Scalar]:
    """Return the widths (5,) [s] of the segments, and the coefficients (5, 4) of the angle [rad].

    The coefficients are ascending in u = (t − start)/width.
    """
    s, d, a = half.constant, half.decreasing, half.acceleration
    coast = xp.maximum(duration - 2 * (s + d), 0.0)
    widths = xp.stack([s, d, coast, d, s])
    zero = xp.zeros_like(a)
    first = xp.stack([a, a, zero, zero, -a])  # the acceleration at the start of each segment
    change = xp.stack([zero, -a, zero, -a, zero])  # the change of the acceleration in each segment
    rate_changes = (first + change / 2) * widths
    rates = xp.cumsum(rate_changes) - rate_changes
    powers = xp.stack([rates * widths, first * widths**2 / 2, change * widths**2 / 6], axis=1)
    angle_changes = xp.sum(powers, axis=1)
    angles = xp.cumsum(angle_changes) - angle_changes
    return widths, xp.concatenate([angles[:, None], powers], axis=1)


def _starts(half: _Half, duration: Scalar) -> Scalar:
    """Return the start times (5,) [s] of the segments."""
    s, d = half.constant, half.decreasing
    return xp.stack([xp.zeros_like(s), s, s + d, duration - s - d, duration - s])


def _where(condition: Scalar, a: _Half, b: _Half) -> _Half:
    return _Half(
        xp.where(condition, a.constant, b.constant),
        xp.where(condition, a.decreasing, b.decreasing),
        xp.where(condition, a.acceleration, b.acceleration),
    )


def _root(x: Scalar) -> Scalar:
    """Return √x, or 0 with zero gradient for x ≤ 0."""
    positive = x > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, x, 1.0)), 0.0)
