"""Compute time-optimal profiles, the fastest slews within limits on rate and acceleration."""

from typing import ClassVar

import equinox as eqx

from qtraj.foundation.arrays import concrete, real_scalar, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import stop_gradient, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Scalar
from qtraj.motion.profiles.profile import (
    TOLERANCE,
    AbstractProfile,
    Profile,
    fixed_duration,
    is_nonzero,
    limit,
    nonzero_size,
    require_limits,
)

RAMP_ROUND_OFF = 8
"""Relative error of the end rates, in machine epsilons, within which the angle of a slew is that of a single ramp."""


@storable
class TimeOptimal(AbstractProfile):
    """The time-optimal profile of full acceleration, a coast if `max_rate` is reached, and full deceleration.

    `max_rate` [rad/s]: the limit on the rate, by default None for no limit. `max_acceleration` [rad/s²]: the limit on
    the acceleration, which is required. `start_rate` and `end_rate` [rad/s], about the axis of the slew, are zero for
    None. If a fixed `duration` [s] exceeds the minimum, the slew coasts at another rate; the acceleration keeps its
    limit value. The profile is optimal among slews about a fixed axis, and among all slews of a spherical body with a
    limit on |ε|. If the acceleration about each body axis has its own limit, slews about a moving axis can be faster
    (Bilimoria and Wie 1993: 180° about a body axis, unit inertia and torques, in 3.24308 s instead of 3.54491 s). For a
    distance along a line, read m instead of rad.

    **Raises:** ValueError if `max_acceleration` is missing, if a limit or the duration is not positive, or if the
    magnitude of a start or end rate exceeds `max_rate`. `profile` raises a ValueError if the duration is too short, or
    not possible with these rates.
    """

    max_rate: Scalar | None
    max_acceleration: Scalar
    start_rate: Scalar | None
    end_rate: Scalar | None
    duration: Scalar | None
    name: ClassVar[str] = "time-optimal"
    supports_numpy: ClassVar[bool] = True

    def __init__(
        self,
        max_rate: ArrayInput | None = None,
        max_acceleration: ArrayInput | None = None,
        start_rate: ArrayInput | None = None,
        end_rate: ArrayInput | None = None,
        duration: ArrayInput | None = None,
    ):
        self.max_rate = limit(max_rate)
        self.max_acceleration = real_scalar(max_acceleration, "max_acceleration")
        self.start_rate = None if start_rate is None else real_scalar(start_rate, "start_rate")
        self.end_rate = None if end_rate is None else real_scalar(end_rate, "end_rate")
        self.duration = None if duration is None else real_scalar(duration, "duration")
        require_limits(self)
        for rate, name in ((self.start_rate, "start_rate"), (self.end_rate, "end_rate")):
            if rate is not None:
                require_finite(rate, name)
                _require_within(rate, self.max_rate, name)

    def __repr__(self) -> str:
        return shown(self, duration="s")  # the unit of the angle is the caller's

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and the minimum duration [s] within the limits."""
        return _timed(self, total)


def _timed(motion_profile: TimeOptimal, total: Scalar) -> tuple[Profile, Scalar]:
    resting = motion_profile.start_rate is None and motion_profile.end_rate is None
    task = _Task(
        angle=nonzero_size(total) if resting else total,
        start=_value(motion_profile.start_rate, total),
        end=_value(motion_profile.end_rate, total),
        rate=None if motion_profile.max_rate is None else motion_profile.max_rate.astype(total.dtype),
        acceleration=motion_profile.max_acceleration.astype(total.dtype),
    )
    coast = _fastest(task)
    if resting:
        nonzero = is_nonzero(total)
        coast = _Coast(*(xp.where(nonzero, x, 0.0) for x in (coast.rate, coast.width, coast.duration)))
    minimum, feasible = coast.duration, xp.asarray(True)
    if motion_profile.duration is not None:
        size = minimum + (abs(task.start) + abs(task.end)) / task.acceleration
        duration, long_enough = fixed_duration(motion_profile.duration.astype(total.dtype), minimum, size)
        coast, exists = _in_time(task, duration)
        feasible = long_enough & exists
    return _chain(task, coast, total, feasible, resting), minimum


class _Task(eqx.Module):
    """The requirements of a slew: angle [rad], end rates [rad/s], limits of rate [rad/s] and acceleration [rad/s²]."""

    angle: Scalar
    start: Scalar
    end: Scalar
    rate: Scalar | None
    acceleration: Scalar


class _Coast(eqx.Module):
    """The coast phase of a slew: its rate [rad/s] and duration `width` [s], and the duration [s] of the whole slew."""

    rate: Scalar
    width: Scalar
    duration: Scalar


def _fastest(task: _Task) -> _Coast:
    """Return the coast of the fastest slew of Φ from rate v0 to rate v1, for limits V of rate and A of acceleration.

    The peak rate of the slew is v_p = s√(sAΦ + (v0² + v1²)/2) with a sign s = ±1. If |v_p| would exceed V, the slew
    coasts at sV. s·v_p is at least s·v0 and s·v1, and equal to the larger of these on a ramp.
    """
    angle, v0, v1, acceleration = task.angle, task.start, task.end, task.acceleration
    sense, is_ramp = _sense(task)
    speed = _root(sense * acceleration * angle + (v0**2 + v1**2) / 2)
    lowest = xp.maximum(sense * v0, sense * v1)
    peak = sense * _rounded(speed, xp.where(is_ramp, lowest, xp.maximum(speed, lowest)))
    width = xp.zeros_like(angle)
    if task.rate is not None:
        clipped = abs(peak) > task.rate
        max_rate = xp.where(clipped, task.rate, 1.0)
        coasted = angle - sense * (2 * max_rate**2 - v0**2 - v1**2) / (2 * acceleration)
        width = xp.where(clipped, coasted / (sense * max_rate), width)
        width = _rounded(width, xp.maximum(width, 0.0))
        peak = xp.where(clipped, sense * max_rate, peak)
    ramps = sense * ((peak - v0) + (peak - v1)) / acceleration
    return _Coast(peak, width, ramps + width)


def _sense(task: _Task) -> tuple[Scalar, Flag]:
    """Return the sign s of `_fastest`, and whether Φ is the angle of a single ramp from v0 to v1.

    If v0 and v1 have the same sign, the duration is discontinuous at the angle of the ramp: for a slightly smaller
    angle, the slew must reverse. Round-off must not decide on this, so an angle within `RAMP_ROUND_OFF` of the ramp
    counts as the ramp, for which s is the sign of v0 and v1.
    """
    v0, v1 = task.start, task.end
    excess = task.angle - (v0 + v1) * abs(v1 - v0) / (2 * task.acceleration)
    round_off = RAMP_ROUND_OFF * float(xp.finfo(excess.dtype).eps) * (v0**2 + v1**2) / (2 * task.acceleration)
    is_ramp = abs(excess) <= round_off
    return xp.where(xp.where(is_ramp, v0 + v1, excess) < 0, -1.0, 1.0).astype(excess.dtype), is_ramp


def _rounded(x: Scalar, value: Scalar) -> Scalar:
    """Return `value`, which differs from `x` only by round-off, with the derivative of `x`."""
    return x + stop_gradient(value - x)


def _in_time(task: _Task, duration: Scalar) -> tuple[_Coast, Flag]:
    """Return the coast of a slew of duration T, and whether such a slew exists within the limits.

    Let m be the mean and Δ the difference of the end rates, v = m + y the coasting rate, Φ the angle, and A the
    acceleration. For |y| ≤ |Δ|/2, the angle is linear in y; otherwise y² − AT|y| + Δ²/4 + A|Φ − mT| = 0. For a slew
    from rest to rest, v = ½(AT − √(A²T² − 4AΦ)), which is evaluated without cancellation.
    """
    v0, v1, a = task.start, task.end, task.acceleration
    mean, change = (v0 + v1) / 2, abs(v1 - v0)
    offset = task.angle - mean * duration
    spare_time = duration - change / a
    between = (abs(offset) <= change / 2 * spare_time) & (spare_time > 0)
    linear = offset / xp.where(between, spare_time, 1.0)
    square = (a * duration) ** 2 - change**2 - 4 * a * abs(offset)
    outer = 2 * (a * abs(offset) + change**2 / 4) / (a * duration + _root(square))
    outer = _rounded(outer, xp.minimum(outer, a * duration / 2))  # so that the ramps do not last longer than T
    rate = mean + xp.where(between, linear, xp.where(offset < 0, -outer, outer))
    width = xp.maximum(duration - (abs(rate - v0) + abs(rate - v1)) / a, 0.0)
    slack = 4 * TOLERANCE * float(xp.finfo(duration.dtype).eps)
    size = a * duration + abs(v0) + abs(v1)  # of the rates of which `square` and `spare_time` are differences
    exists = (square >= -slack * size**2) & (a * spare_time >= -slack * size)
    if task.rate is not None:
        # At the minimum T, v is a double root, so only half of its digits are accurate.
        exists &= abs(rate) <= task.rate * (1 + slack**0.5)
        # At the minimum T, v equals the limit, which round-off must not exceed.
        rate = xp.clip(rate, -task.rate, task.rate)
    return _Coast(rate, width, duration), exists


def _chain(task: _Task, coast: _Coast, total: Scalar, feasible: Flag, resting: bool) -> Profile:
    """Return the profile of three segments with the rates v0 → v, v and v → v1.

    v0 and v1 are the end rates, and v is the coasting rate. The coefficients are divided by the angle if the slew is at
    rest at both ends (`resting`).
    """
    v0, v, v1 = task.start, coast.rate, task.end
    first, last = abs(v - v0) / task.acceleration, abs(v1 - v) / task.acceleration
    widths = xp.stack([first, coast.width, last])
    linear = xp.stack([v0, v, v]) * widths
    square = xp.stack([(v - v0) / 2, xp.zeros_like(v), (v1 - v) / 2]) * widths
    constant = xp.cumsum(linear + square) - (linear + square)
    pieces = xp.stack([constant, linear, square], axis=1)
    return Profile(
        total=total,
        duration=coast.duration,
        starts=xp.stack([xp.zeros_like(v), first, coast.duration - last]),
        widths=widths,
        pieces=pieces / task.angle if resting else pieces,
        end_rate=v1,
        feasible=feasible,
        proportional=resting,
    )


def _root(x: Scalar) -> Scalar:
    """Return √x, or 0 with zero gradient for x ≤ 0."""
    positive = x > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, x, 1.0)), 0.0)


def _value(rate: Scalar | None, like: Scalar) -> Scalar:
    return xp.zeros_like(like) if rate is None else rate.astype(like.dtype)


def _require_within(rate: Scalar, bound: Scalar | None, name: str) -> None:
    value, max_rate = concrete(rate), None if bound is None else concrete(bound)
    if value is not None and max_rate is not None and abs(value) > max_rate:
        raise ValueError(
            f"|{name}| must not exceed max_rate, but {name} = {float(value)!r} and max_rate = {float(max_rate)!r} were "
            "given"
        )
