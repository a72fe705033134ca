"""Compute S-curve profiles, the fastest slews from rest to rest within limits on rate, acceleration and jerk."""

import math
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import real_scalar
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import stop_gradient, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Scalar
from qtraj.motion.profiles.profile import (
    AbstractProfile,
    Profile,
    fixed_duration,
    is_nonzero,
    limit,
    nonzero_size,
    require_limits,
)

JERKS = (1, 0, -1, 0, -1, 0, 1)
"""The jerk of the seven segments, divided by the jerk limit."""


@storable
class SCurve(AbstractProfile):
    """The S-curve profile, with seven segments of constant jerk and a trapezoidal or triangular acceleration.

    The limits are `max_rate` [rad/s], by default None for no limit, `max_acceleration` [rad/s²] and `max_jerk`
    [rad/s³], which are required. If a fixed `duration` [s] exceeds the minimum, the slew coasts at a lower rate; the
    jerk keeps its limit value. For a distance along a line, read m instead of rad.

    **Raises:** ValueError for a missing limit, and for values that are not positive. `profile` raises a ValueError if
    the duration is too short.
    """

    max_rate: Scalar | None
    max_acceleration: Scalar
    max_jerk: Scalar
    duration: Scalar | None
    name: ClassVar[str] = "S-curve"
    supports_numpy: ClassVar[bool] = True

    def __init__(
        self,
        max_rate: ArrayInput | None = None,
        max_acceleration: ArrayInput | None = None,
        max_jerk: ArrayInput | None = None,
        duration: ArrayInput | None = None,
    ):
        self.max_rate = limit(max_rate)
        self.max_acceleration = real_scalar(max_acceleration, "max_acceleration")
        self.max_jerk = real_scalar(max_jerk, "max_jerk")
        self.duration = limit(duration)
        require_limits(self)

    def __repr__(self) -> str:
        return shown(self, duration="s")  # the unit of the angle is the caller's

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and the minimum duration [s] within the limits."""
        return _timed(self, total)


def _timed(motion_profile: SCurve, total: Scalar) -> tuple[Profile, Scalar]:
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
    """Return the profile.

    `ramp` contains the widths [s] of the first four of the seven segments; `jerk` is the jerk divided by the angle
    [1/s³].
    """
    widths = xp.concatenate([ramp, ramp[2::-1]])
    before = xp.cumsum(ramp) - ramp
    # For acceleration, rate and angle: the change in each segment, then the value at the start of each segment.
    acceleration_steps = jerk * np.asarray(JERKS, jerk.dtype) * widths
    accelerations = xp.cumsum(acceleration_steps) - acceleration_steps
    rate_steps = (accelerations + acceleration_steps / 2) * widths
    rates = xp.cumsum(rate_steps) - rate_steps
    powers = xp.stack([rates * widths, accelerations * widths**2 / 2, acceleration_steps * widths**2 / 6], axis=1)
    angle_steps = xp.sum(powers, axis=1)
    angles = xp.cumsum(angle_steps) - angle_steps
    return Profile(
        total=total,
        duration=duration,
        starts=xp.concatenate([before, duration - xp.cumsum(ramp)[2::-1]]),
        widths=widths,
        pieces=xp.concatenate([angles[:, None], powers], axis=1),
        end_rate=xp.zeros_like(total),
        feasible=feasible,
    )
