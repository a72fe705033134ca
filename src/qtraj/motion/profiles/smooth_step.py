"""Compute profiles from rest to rest that consist of a single cubic, quintic or septic polynomial."""

from typing import ClassVar

import equinox as eqx

from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import Scalar
from qtraj.motion.profiles.profile import (
    AbstractProfile,
    Profile,
    fixed_duration,
    is_nonzero,
    limit,
    nonzero_size,
    require_limits,
    user_limits,
)


class AbstractSmoothStep(AbstractProfile):
    """A profile s(t/T)·Φ with the duration T, the total angle Φ, and a polynomial s(u) from s(0) = 0 to s(1) = 1.

    The derivative of s is zero at both ends. `coefficients`: the coefficients of s, ascending. `peaks`: the maxima of
    |ds/du|, |d²s/du²| and |d³s/du³|.
    """

    max_rate: eqx.AbstractVar[Scalar | None]
    max_acceleration: eqx.AbstractVar[Scalar | None]
    max_jerk: eqx.AbstractVar[Scalar | None]
    coefficients: ClassVar[tuple[int, ...]]
    peaks: ClassVar[tuple[float, float, float]]

    def __check_init__(self):
        if not user_limits(self):
            raise ValueError(
                f"a {self.name} profile needs a duration [s] or a limit: max_rate, max_acceleration or max_jerk"
            )
        require_limits(self)

    def __repr__(self) -> str:
        return shown(self, duration="s")  # the unit of the angle is the caller's

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and the minimum duration [s] within the limits."""
        minimum = duration = self._shortest(total)
        feasible = xp.asarray(True)
        if self.duration is not None:
            duration, feasible = fixed_duration(self.duration.astype(total.dtype), minimum)
        profile = Profile(
            total=total,
            duration=duration,
            starts=xp.zeros_like(total, shape=1),
            widths=duration[None],
            pieces=xp.asarray([self.coefficients], dtype=total.dtype),
            end_rate=xp.zeros_like(total),
            feasible=feasible,
        )
        return profile, minimum

    def _shortest(self, total: Scalar) -> Scalar:
        """Return the minimum duration max(c1 Φ/V, √(c2 Φ/A), (c3 Φ/J)^⅓) [s], or 0 without limits.

        c1, c2 and c3 are the elements of `peaks`. V, A and J are the limits on rate, acceleration and jerk. A limit
        that is None is omitted.
        """
        size = nonzero_size(total)
        limits = (self.max_rate, self.max_acceleration, self.max_jerk)
        times = [
            (peak * size / bound.astype(total.dtype)) ** (1 / order)
            for order, (peak, bound) in enumerate(zip(self.peaks, limits, strict=True), start=1)
            if bound is not None
        ]
        longest = xp.max(xp.stack(times)) if times else xp.zeros_like(total)
        return xp.where(is_nonzero(total), longest, 0.0)


@storable
class Cubic(AbstractSmoothStep):
    """The cubic profile (3u² − 2u³)Φ, u = t/T, with the total angle Φ; it is at rest at both ends.

    `duration` [s] is the duration T. With None, T is the minimum that satisfies `max_rate` [rad/s], `max_acceleration`
    [rad/s²] and `max_jerk` [rad/s³]. If a duration and limits are given, the duration must satisfy the limits. The
    acceleration jumps at both ends, and the jerk limit applies between these jumps. For a distance along a line, read m
    instead of rad.

    **Raises:** ValueError for values that are not positive, or if both duration and limits are missing. `profile`
    raises a ValueError if the duration is too short for a limit.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)
    name: ClassVar[str] = "cubic"
    supports_numpy: ClassVar[bool] = True
    coefficients: ClassVar[tuple[int, ...]] = (0, 0, 3, -2)
    peaks: ClassVar[tuple[float, float, float]] = (1.5, 6.0, 12.0)


@storable
class Quintic(AbstractSmoothStep):
    """The quintic profile (10u³ − 15u⁴ + 6u⁵)Φ, u = t/T, at rest and without acceleration at both ends.

    The arguments and errors are the same as for `Cubic`. The jerk is bounded.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)
    name: ClassVar[str] = "quintic"
    supports_numpy: ClassVar[bool] = True
    coefficients: ClassVar[tuple[int, ...]] = (0, 0, 0, 10, -15, 6)
    peaks: ClassVar[tuple[float, float, float]] = (15 / 8, 10 / 3**0.5, 60.0)


@storable
class Septic(AbstractSmoothStep):
    """The septic profile (35u⁴ − 84u⁵ + 70u⁶ − 20u⁷)Φ, u = t/T, at rest at both ends.

    Acceleration and jerk are zero at both ends, and the jerk is continuous. The arguments and errors are the same as
    for `Cubic`.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)
    name: ClassVar[str] = "septic"
    supports_numpy: ClassVar[bool] = True
    coefficients: ClassVar[tuple[int, ...]] = (0, 0, 0, 0, 35, -84, 70, -20)
    peaks: ClassVar[tuple[float, float, float]] = (35 / 16, 84 * 5**0.5 / 25, 52.5)
