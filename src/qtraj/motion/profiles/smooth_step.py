"""Polynomial profiles: one cubic, quintic or septic from rest to rest."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from qtraj.foundation.document import storable
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
    """Φ(t) = Φ s(u), u = t/T, with one polynomial s that rises from 0 to 1 on [0, 1] and rests at both ends.

    `coefficients`: the coefficients of s, ascending. `peaks`: the maxima of |ds/du|, |d²s/du²| and |d³s/du³|.
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
        return shown(self, duration="s", max_rate="rad/s", max_acceleration="rad/s²", max_jerk="rad/s³")

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """The profile of a slew by `total` [rad], and the minimum duration [s] within the limits."""
        minimum = duration = self._shortest(total)
        feasible = jnp.asarray(True)
        if self.duration is not None:
            duration, feasible = fixed_duration(self.duration.astype(total.dtype), minimum)
        profile = Profile(
            total=total,
            duration=duration,
            starts=jnp.zeros_like(total, shape=1),
            widths=duration[None],
            pieces=jnp.asarray([self.coefficients], dtype=total.dtype),
            end_rate=jnp.zeros_like(total),
            feasible=feasible,
        )
        return profile, minimum

    def _shortest(self, total: Scalar) -> Scalar:
        """T = max(c1 Φ/V, √(c2 Φ/A), (c3 Φ/J)^⅓) over the limits that are not None; 0 without limits."""
        size = nonzero_size(total)
        limits = (self.max_rate, self.max_acceleration, self.max_jerk)
        times = [
            (peak * size / bound.astype(total.dtype)) ** (1 / order)
            for order, (peak, bound) in enumerate(zip(self.peaks, limits, strict=True), start=1)
            if bound is not None
        ]
        longest = jnp.max(jnp.stack(times)) if times else jnp.zeros_like(total)
        return jnp.where(is_nonzero(total), longest, 0.0)


@storable
class Cubic(AbstractSmoothStep):
    """Φ(t) = Φ(3u² − 2u³), u = t/T: at rest at both ends, where the acceleration jumps.

    `duration` [s] fixes T. Without it, T is the minimum that satisfies `max_rate` [rad/s], `max_acceleration` [rad/s²]
    and `max_jerk` [rad/s³]. With a duration and limits, the limits are checked. The jerk limit applies between the two
    jumps of the acceleration.

    **Raises:** ValueError for values that are not positive, or without a duration and limits; in `profile` for a
    duration that violates a limit.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)
    name: ClassVar[str] = "cubic"
    coefficients: ClassVar[tuple[int, ...]] = (0, 0, 3, -2)
    peaks: ClassVar[tuple[float, float, float]] = (1.5, 6.0, 12.0)


@storable
class Quintic(AbstractSmoothStep):
    """Φ(t) = Φ(10u³ − 15u⁴ + 6u⁵), u = t/T: at rest and without acceleration at both ends.

    The arguments and errors are the same as for `Cubic`. The jerk is bounded.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)
    name: ClassVar[str] = "quintic"
    coefficients: ClassVar[tuple[int, ...]] = (0, 0, 0, 10, -15, 6)
    peaks: ClassVar[tuple[float, float, float]] = (15 / 8, 10 / 3**0.5, 60.0)


@storable
class Septic(AbstractSmoothStep):
    """Φ(t) = Φ(35u⁴ − 84u⁵ + 70u⁶ − 20u⁷), u = t/T: at rest, without acceleration and without jerk at both ends.

    The arguments and errors are the same as for `Cubic`. The jerk is continuous.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)
    name: ClassVar[str] = "septic"
    coefficients: ClassVar[tuple[int, ...]] = (0, 0, 0, 0, 35, -84, 70, -20)
    peaks: ClassVar[tuple[float, float, float]] = (35 / 16, 84 * 5**0.5 / 25, 52.5)
