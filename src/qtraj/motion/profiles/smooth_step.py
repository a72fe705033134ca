"""Polynomial turns: one cubic, quintic or septic from rest to rest."""

import equinox as eqx
import jax.numpy as jnp

from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.profiles.profile import (
    AbstractLaw,
    Profile,
    fixed_duration,
    is_turn,
    known_angle,
    limit,
    require_feasible,
    require_limits,
    size_of,
)


class _Step(eqx.Module):
    """A polynomial s(u) from 0 to 1 on [0, 1], and the largest |ds/du|, |d²s/du²| and |d³s/du³|."""

    name: str = eqx.field(static=True)
    coefficients: tuple[int, ...] = eqx.field(static=True)
    peaks: tuple[float, float, float] = eqx.field(static=True)


_CUBIC = _Step("cubic", (0, 0, 3, -2), (1.5, 6.0, 12.0))
_QUINTIC = _Step("quintic", (0, 0, 0, 10, -15, 6), (15 / 8, 10 / 3**0.5, 60.0))
_SEPTIC = _Step("septic", (0, 0, 0, 0, 35, -84, 70, -20), (35 / 16, 84 * 5**0.5 / 25, 52.5))


@storable
class Cubic(AbstractLaw):
    """Φ(t) = Φ(3u² − 2u³), u = t/T: at rest at both ends, where its acceleration jumps.

    In the given `duration` [s], or the shortest that keeps `max_rate` [rad/s], `max_acceleration` [rad/s²] and
    `max_jerk` [rad/s³]; with both, the limits are checked. The jerk limit holds between the two jumps.

    **Raises:** ValueError for values that are not positive, or where nothing is given; in `profile` for a duration
    in which a limit would break.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)

    def __check_init__(self):
        _check(self, _CUBIC)

    def profile(self, angle: ArrayInput) -> Profile:
        return _profile(self, _CUBIC, angle)


@storable
class Quintic(AbstractLaw):
    """Φ(t) = Φ(10u³ − 15u⁴ + 6u⁵), u = t/T: at rest and without acceleration at both ends.

    Arguments and errors as for `Cubic`; the jerk is bounded everywhere.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)

    def __check_init__(self):
        _check(self, _QUINTIC)

    def profile(self, angle: ArrayInput) -> Profile:
        return _profile(self, _QUINTIC, angle)


@storable
class Septic(AbstractLaw):
    """Φ(t) = Φ(35u⁴ − 84u⁵ + 70u⁶ − 20u⁷), u = t/T: at rest, without acceleration and without jerk at both ends.

    Arguments and errors as for `Cubic`; the jerk is continuous.
    """

    duration: Scalar | None = eqx.field(converter=limit, default=None)
    max_rate: Scalar | None = eqx.field(converter=limit, default=None)
    max_acceleration: Scalar | None = eqx.field(converter=limit, default=None)
    max_jerk: Scalar | None = eqx.field(converter=limit, default=None)

    def __check_init__(self):
        _check(self, _SEPTIC)

    def profile(self, angle: ArrayInput) -> Profile:
        return _profile(self, _SEPTIC, angle)


_Law = Cubic | Quintic | Septic


def _check(law: _Law, step: _Step) -> None:
    limits = {"max_rate": law.max_rate, "max_acceleration": law.max_acceleration, "max_jerk": law.max_jerk}
    if law.duration is None and all(value is None for value in limits.values()):
        raise ValueError(f"a {step.name} turn needs a duration [s] or a limit: max_rate, max_acceleration or max_jerk")
    require_limits(duration=law.duration, **limits)


def _profile(law: _Law, step: _Step, angle: ArrayInput) -> Profile:
    profile, minimal = _timed(law, step, known_angle(angle))
    require_feasible(profile, minimal, law.duration, step.name)
    return profile


@eqx.filter_jit
def _timed(law: _Law, step: _Step, total: Scalar) -> tuple[Profile, Scalar]:
    """The profile, and the least duration."""
    minimal = duration = _shortest(law, step, total)
    feasible = jnp.asarray(True)
    if law.duration is not None:
        duration, feasible = fixed_duration(law.duration.astype(total.dtype), minimal)
    profile = Profile(
        total=total,
        duration=duration,
        starts=jnp.zeros_like(total, shape=1),
        widths=duration[None],
        pieces=jnp.asarray([step.coefficients], dtype=total.dtype),
        end_rate=jnp.zeros_like(total),
        feasible=feasible,
    )
    return profile, minimal


def _shortest(law: _Law, step: _Step, total: Scalar) -> Scalar:
    """T = max(c1 Φ/V, √(c2 Φ/A), (c3 Φ/J)^⅓) over the limits that are given; 0 without any."""
    size = size_of(total)
    times = [
        (peak * size / bound.astype(total.dtype)) ** (1 / order)
        for order, (peak, bound) in enumerate(
            zip(step.peaks, (law.max_rate, law.max_acceleration, law.max_jerk), strict=True), start=1
        )
        if bound is not None
    ]
    longest = jnp.max(jnp.stack(times)) if times else jnp.zeros_like(total)
    return jnp.where(is_turn(total), longest, 0.0)
