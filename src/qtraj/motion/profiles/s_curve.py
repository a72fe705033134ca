"""Compute S-curve profiles, the fastest slews within limits on rate, acceleration and jerk."""

import math
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import real_scalar
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import stop_gradient, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Scalar
from qtraj.motion.profiles.jerk_limited.between import Task, segments
from qtraj.motion.profiles.jerk_limited.durations import durations_text
from qtraj.motion.profiles.jerk_limited.pieces import jerk_pieces
from qtraj.motion.profiles.jerk_limited.states import require_states
from qtraj.motion.profiles.profile import (
    END_STATES,
    AbstractProfile,
    Profile,
    fixed_duration,
    is_nonzero,
    limit,
    nonzero_size,
    require_limits,
)

JERKS = (1, 0, -1, 0, -1, 0, 1)
"""The jerk of the seven segments of a slew from rest to rest, divided by the jerk limit."""


@storable
class SCurve(AbstractProfile):
    """The S-curve profile, the fastest slew with limited jerk between any rates and accelerations at its ends.

    The profile consists of segments of constant jerk, seven from rest to rest, with a trapezoidal or triangular
    acceleration. It overshoots the angle, or starts in the opposite direction, where the rates and accelerations at the
    ends make this unavoidable. If a start rate or acceleration exceeds its limit, or the start acceleration would carry
    the rate beyond `max_rate`, the slew first brakes as fast as possible until it is within the limits; the rest is the
    fastest slew from there.

    With a fixed `duration` that exceeds the minimum, the slew coasts at another rate, between ramps with full jerk and
    acceleration. With rates or accelerations at the ends, some durations above the minimum may not be possible in this
    way. For a distance along a line, read m instead of rad. The method is explained in docs/concepts/motion.md.

    Args:
        max_rate: The limit on the rate [rad/s], by default None for no limit.
        max_acceleration: The limit on the acceleration [rad/s²], required.
        max_jerk: The limit on the jerk [rad/s³], required.
        duration: The duration [s], by default None for the minimum.
        start_rate: The rate at the start [rad/s] about the axis of the slew, of either sign, by default None for zero.
        end_rate: The rate at the end [rad/s].
        start_acceleration: The acceleration at the start [rad/s²], by default None for zero.
        end_acceleration: The acceleration at the end [rad/s²].

    Raises:
        ValueError: For a missing limit, for limits or a duration that are not positive, for states that are not finite,
            and for an end rate or an end acceleration that the limits forbid. `profile` raises a ValueError if the
            duration is too short or not possible; the message names possible durations.

    Example:
        >>> profile = SCurve(1.0, 2.0, 8.0, start_rate=0.5, end_rate=-0.5).profile(0.0)
        >>> print(f"{profile.duration:.4f} s")
        1.2071 s
    """

    max_rate: Scalar | None
    max_acceleration: Scalar
    max_jerk: Scalar
    duration: Scalar | None
    start_rate: Scalar | None
    end_rate: Scalar | None
    start_acceleration: Scalar | None
    end_acceleration: Scalar | None
    name: ClassVar[str] = "S-curve"
    supports_numpy: ClassVar[bool] = True

    def __init__(
        self,
        max_rate: ArrayInput | None = None,
        max_acceleration: ArrayInput | None = None,
        max_jerk: ArrayInput | None = None,
        duration: ArrayInput | None = None,
        start_rate: ArrayInput | None = None,
        end_rate: ArrayInput | None = None,
        start_acceleration: ArrayInput | None = None,
        end_acceleration: ArrayInput | None = None,
    ):
        self.max_rate = limit(max_rate)
        self.max_acceleration = real_scalar(max_acceleration, "max_acceleration")
        self.max_jerk = real_scalar(max_jerk, "max_jerk")
        self.duration = None if duration is None else real_scalar(duration, "duration")
        self.start_rate = None if start_rate is None else real_scalar(start_rate, "start_rate")
        self.end_rate = None if end_rate is None else real_scalar(end_rate, "end_rate")
        self.start_acceleration = (
            None if start_acceleration is None else real_scalar(start_acceleration, "start_acceleration")
        )
        self.end_acceleration = None if end_acceleration is None else real_scalar(end_acceleration, "end_acceleration")
        require_limits(self)
        require_states(self)

    def __repr__(self) -> str:
        return shown(self, duration="s")  # the unit of the angle is the caller's

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and the minimum duration [s] within the limits."""
        resting = all(getattr(self, name) is None for name in END_STATES)
        return _from_rest_to_rest(self, total) if resting else _between_states(self, total)

    def possible_durations(self, total: ArrayInput) -> str:
        """Describe the durations [s] that a slew of `total` [rad] can have."""
        angle: Any = np.asarray(total, float)
        return durations_text(_task(self, angle))


def _task(motion_profile: SCurve, total: Scalar) -> Task:
    def value(x: Scalar | None) -> Scalar:
        return xp.zeros_like(total) if x is None else x.astype(total.dtype)

    return Task(
        distance=total,
        v0=value(motion_profile.start_rate),
        a0=value(motion_profile.start_acceleration),
        v1=value(motion_profile.end_rate),
        a1=value(motion_profile.end_acceleration),
        max_rate=None if motion_profile.max_rate is None else motion_profile.max_rate.astype(total.dtype),
        max_acceleration=motion_profile.max_acceleration.astype(total.dtype),
        max_jerk=motion_profile.max_jerk.astype(total.dtype),
    )


def _between_states(motion_profile: SCurve, total: Scalar) -> tuple[Profile, Scalar]:
    task = _task(motion_profile, total)
    user = motion_profile.duration
    found = segments(task, None if user is None else user.astype(total.dtype))
    ends, feasible = xp.cumsum(found.widths), found.exists
    duration = ends[-1]
    if user is not None:
        feasible = feasible & xp.isfinite(user)
        duration = xp.where(feasible, user.astype(total.dtype), duration)
    profile = Profile(
        total=total,
        duration=duration,
        starts=ends - found.widths,
        widths=found.widths,
        pieces=jerk_pieces(found.widths, found.jerks, task.v0, task.a0),
        end_rate=task.v1,
        feasible=feasible,
        proportional=False,
        end_acceleration=task.a1,
    )
    return profile, found.minimum


def _from_rest_to_rest(motion_profile: SCurve, total: Scalar) -> tuple[Profile, Scalar]:
    a, j = motion_profile.max_acceleration.astype(total.dtype), motion_profile.max_jerk.astype(total.dtype)
    size = nonzero_size(total)
    rate, coasting = _peak_rate(size, a, j), xp.asarray(False)
    if motion_profile.max_rate is not None:
        max_rate = motion_profile.max_rate.astype(total.dtype)
        coasting = rate > max_rate
        rate = xp.where(coasting, max_rate, rate)
    ramp, full = (xp.where(is_nonzero(total), x, 0.0) for x in _ramp(rate, a, j))
    coast = xp.where(coasting, size / rate - full, 0.0)
    minimum = duration = 2 * full + coast
    feasible = xp.asarray(True)
    if motion_profile.duration is not None:
        duration, feasible = fixed_duration(motion_profile.duration.astype(total.dtype), minimum)
        slower = _rate_in_time(size, duration, a, j)
        # At the minimum duration, v may be almost a double root. An inaccurate v must not exceed the fastest slew's
        # rate, because its ramps would then last longer than the duration. The derivative of v is kept.
        ramp, full = _ramp(slower - stop_gradient(xp.maximum(slower - rate, 0.0)), a, j)
        coast = xp.maximum(duration - 2 * full, 0.0)
    first_half = xp.stack([ramp, full - 2 * ramp, ramp, coast])
    return _chain(total, duration, first_half, j / size, feasible), minimum


def _peak_rate(angle: Scalar, a: Scalar, j: Scalar) -> Scalar:
    """Return the peak rate v [rad/s] of a slew of Φ = `angle` without a coast: v·Ta(v) = Φ with Ta of `_ramp`."""
    long = angle >= 2 * a * (a / j) ** 2
    flat = 2 * angle / (a / j + xp.sqrt((a / j) ** 2 + 4 * angle / a))
    return xp.where(long, flat, (angle * (angle * (j / 4))) ** (1 / 3))


def _ramp(rate: Scalar, a: Scalar, j: Scalar) -> tuple[Scalar, Scalar]:
    """Return the time Tj [s] of increasing acceleration, and the total time Ta [s] from rest to `rate`.

    `a` [rad/s²] and `j` [rad/s³] are the limits on acceleration and jerk.
    """
    pointed = rate < a * (a / j)
    corner = xp.sqrt(xp.where(pointed, rate / j, 1.0))
    return xp.where(pointed, corner, a / j), xp.where(pointed, 2 * corner, a / j + rate / a)


def _rate_in_time(angle: Scalar, duration: Scalar, a: Scalar, j: Scalar) -> Scalar:
    """Return the coasting rate v [rad/s] of a slew of Φ in the time T, the smaller solution of Φ/v + Ta(v) = T.

    Ta is the second result of `_ramp`. If the acceleration limit is reached, v solves a quadratic equation. Otherwise,
    with the jerk limit J, x = √v solves 2x³/√J − Tx² + Φ = 0, with the root (T√J/6)(1 − cos δ + √3 sin δ) and
    sin(3δ/2) = √(27Φ/(JT³)) (Viète).
    """
    pointed = (angle <= 2 * a * (a / j) ** 2) | (duration >= angle * (j / a) / a + 2 * a / j)
    left = xp.where(pointed, duration, duration - a / j)
    square = left**2 - 4 * angle / a
    root = xp.sqrt(xp.where(pointed | (square <= 0), 1.0, square))
    flat = 2 * angle / (left + xp.where(square <= 0, 0.0, root))
    sine = xp.sqrt(xp.where(pointed, 27 * (angle / duration) / (j * duration**2), 0.5))
    third = xp.arcsin(xp.minimum(sine, 1.0)) / 3
    x = 2 * xp.sin(third) * (xp.sin(third) + math.sqrt(3) * xp.cos(third)) * xp.sqrt(j) * duration / 6
    return xp.where(pointed, x**2, flat)


def _chain(total: Scalar, duration: Scalar, ramp: Float[Array, "4"], jerk: Scalar, feasible: Flag) -> Profile:
    """Return the profile of a slew from rest to rest.

    `ramp` contains the widths [s] of the first four of the seven segments; `jerk` is the jerk divided by the angle
    [1/s³].
    """
    widths = xp.concatenate([ramp, ramp[2::-1]])
    before = xp.cumsum(ramp) - ramp
    return Profile(
        total=total,
        duration=duration,
        starts=xp.concatenate([before, duration - xp.cumsum(ramp)[2::-1]]),
        widths=widths,
        pieces=jerk_pieces(widths, jerk * np.asarray(JERKS, jerk.dtype)),
        end_rate=xp.zeros_like(total),
        feasible=feasible,
    )
