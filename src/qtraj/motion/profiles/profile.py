"""Define motion profiles, which compute the angle Φ(t) of a slew about a fixed axis from limits or a duration.

An `AbstractProfile`, such as `TimeOptimal`, computes the `Profile` of a slew of any angle. A `Profile` is a sequence of
polynomial segments. Each segment is a polynomial in its own variable u = (t − start)/width ∈ [0, 1], so powers of time
cannot overflow or underflow. At a switch between two segments, the values of the second segment are returned. The angle
is constant before the start and after the end of the slew.

No formula depends on the unit of the angle, so a profile can also describe a distance along a line: with limits in m/s,
m/s² and m/s³, the angle Φ is the distance in metres. Messages contain the unit only if the caller specifies it.
"""

import abc
import math
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Polynomial

from qtraj.algebra import polynomial
from qtraj.foundation.argument import require_whole
from qtraj.foundation.arrays import as_float, concrete, one_instant, real_scalar, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy, in_numpy_or_jit, of_arrays, xp
from qtraj.foundation.types import ArrayInput, Flag, Scalar, ScalarLike
from qtraj.motion.profiles.stationary import stationary_points

TOLERANCE = 16
"""Relative tolerance, in machine epsilons, by which a fixed duration may be below the minimum."""
PEAK_TOLERANCE = 1e-9
"""Relative difference below which two peaks count as equal, so that the first peak is reported."""


@storable
class Profile(eqx.Module):
    """The angle of a slew and its derivatives on [0, duration]; for a distance along a line, read m instead of rad.

    The angle is `total` [rad] at `duration` [s]. Segment k of n starts at `starts[k]` [s], lasts `widths[k]` [s] and
    has the ascending coefficients `pieces[k]` (m,) in its variable u. The segments represent angle/total if the
    profile is `proportional` (at rest at both ends), and the angle [rad] otherwise. `end_rate` [rad/s] is the rate at
    `duration`, and `end_acceleration` [rad/s²] the acceleration there, zero for None. Inside a trace, where errors
    cannot be raised, `feasible` is false if the fixed duration is not possible; the profile then has the minimum
    duration.
    """

    total: Scalar = eqx.field(converter=as_float)
    duration: Scalar = eqx.field(converter=as_float)
    starts: Float[Array, " n"] = eqx.field(converter=as_float)
    widths: Float[Array, " n"] = eqx.field(converter=as_float)
    pieces: Float[Array, "n m"] = eqx.field(converter=as_float)
    end_rate: Scalar = eqx.field(converter=as_float)
    feasible: Flag = eqx.field(converter=xp.asarray)
    proportional: bool = eqx.field(static=True, default=True)
    end_acceleration: Scalar | None = None

    @property
    def switches(self) -> Float[Array, " n"]:
        """The end times (n,) [s] of the segments, ascending, to be passed as `jumps` to an integration.

        The last one is `duration`.
        """
        return _switches(self.starts, self.duration)

    def angle(self, t: ScalarLike) -> Scalar:
        """Return Φ(t) [rad]; the angle is 0 before the start and `total` after the end."""
        return self.derivatives(t, 0)[0]

    def rate(self, t: ScalarLike) -> Scalar:
        """Return Φ̇(t) [rad/s]; the rate is `end_rate` at the end and zero after the end."""
        return self.derivatives(t, 1)[1]

    def acceleration(self, t: ScalarLike) -> Scalar:
        """Return Φ̈(t) [rad/s²]; the acceleration is `end_acceleration` at the end and zero after the end."""
        return self.derivatives(t, 2)[2]

    def jerk(self, t: ScalarLike) -> Scalar:
        """Return the third derivative of Φ [rad/s³] between the switches, without the impulses at a jump of Φ̈."""
        return self.derivatives(t, 3)[3]

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, " {order}+1"]:
        """Return Φ and its time derivatives up to `order` at time `t` [s]; derivative k is in rad s^-k."""
        require_whole(order, "the order of a derivative")
        shape = self.shape(t, order)
        return _scaled(shape, self.total) if self.proportional else shape

    def shape(self, t: ScalarLike, order: int) -> Float[Array, " {order}+1"]:
        """Return `derivatives` divided by `total` if the profile is `proportional`, otherwise `derivatives`.

        The shape is computed without a division, so it is regular at total = 0: the product of a rotation vector of
        magnitude `total` and the shape is a smooth function of this vector.
        """
        return _shape(self, one_instant(t).astype(self.duration.dtype), order)

    def peak(self, order: int) -> tuple[float, float]:
        """Return the first instant [s] of the maximum of |d^order Φ/dt^order|, and the maximum.

        The maximum is exact up to rounding errors, because it is computed from the roots of derivatives of the
        segments. Each segment includes its ends, so both sides of a switch are considered. The result is (0, 0) for a
        slew of zero duration.

        **Raises:** ValueError if the profile is traced.
        """
        fields = (self.starts, self.widths, self.pieces)
        if any(concrete(x) is None for x in (*fields, self.total)):
            raise ValueError(
                "Profile.peak needs concrete values, but a traced profile was given: call it outside jit, grad and vmap"
            )
        total = float(self.total) if self.proportional else 1.0
        time, peak = 0.0, 0.0
        for start, width, coefficients in zip(*map(np.asarray, fields), strict=True):
            if not width > 0:
                continue
            curve = Polynomial(coefficients.astype(float)).deriv(order)
            for u in stationary_points(curve):
                with np.errstate(all="ignore"):  # the derivatives overflow for widths near 0
                    value = abs(float(total * np.float64(curve(u)) / width**order))
                if value > peak * (1 + PEAK_TOLERANCE):
                    time, peak = float(start + u * width), value
        return time, peak


@of_arrays
def _switches(starts: Float[Array, " n"], duration: Scalar) -> Float[Array, " n"]:
    # Round-off may exchange the ends of segments of almost zero width, or shift them to before the start.
    return xp.concatenate([xp.clip(xp.sort(starts[1:]), 0.0, duration), duration[None]])


@of_arrays
def _scaled(shape: Float[Array, " _"], total: Scalar) -> Float[Array, " _"]:
    return total * shape


@in_numpy_or_jit
def _shape(profile: Profile, t: Scalar, order: int) -> Float[Array, " {order}+1"]:
    after = t >= profile.duration
    outside = after | (t < 0)
    time = xp.where(outside, 0.0, t)
    # A segment of zero width ends at its start, even if round-off shifts the start of the next segment.
    ends = xp.where(profile.widths[:-1] > 0, profile.starts[1:], profile.starts[:-1])
    piece = xp.sum(time >= ends)
    start, width, coefficients = profile.starts[piece], profile.widths[piece], profile.pieces[piece]
    width = xp.where(width > 0, width, 1.0)
    scales = [math.factorial(k) / width**k for k in range(order + 1)]
    inside = polynomial.taylor(coefficients, (time - start) / width, order) * xp.stack(scales)
    return xp.where(outside, xp.where(after, _final(profile, t, order), 0.0), inside)


def _final(profile: Profile, t: Scalar, order: int) -> Float[Array, " {order}+1"]:
    """Return the shape at the end of the slew and after the end."""
    zero = xp.zeros_like(t)
    final = [xp.ones_like(t) if profile.proportional else profile.total]
    if order > 0:
        final.append(xp.where(t == profile.duration, zero if profile.proportional else profile.end_rate, 0.0))
    if order > 1:
        at_end = profile.end_acceleration
        final.append(zero if at_end is None else xp.where(t == profile.duration, at_end, 0.0))
    return xp.stack(final + [zero] * (order - 2))


class AbstractProfile(eqx.Module):
    """A motion profile, which computes the `Profile` of a slew of any angle, in minimum time or a fixed `duration` [s].

    A profile can also describe a distance along a line; read m instead of rad. `name` is the name of the motion profile
    in messages.
    """

    duration: eqx.AbstractVar[Scalar | None]
    name: ClassVar[str]
    supports_numpy: ClassVar[bool] = False
    """Whether `timed` accepts and returns NumPy arrays; other profiles are computed by JAX, which compiles them."""

    @abc.abstractmethod
    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and the minimum duration [s] within the limits."""

    def profile(self, angle: ArrayInput, unit: str = "") -> Profile:
        """Return the profile of a slew of `angle` [rad], or of a distance [m], of either sign.

        `unit` is the unit in messages, such as "rad" or "m".

        **Raises:** ValueError for an angle that is not finite, and for a fixed duration that is too short for the angle
        within the limits. Inside a trace, no error is raised for such a duration; the profile's `feasible` is then
        false.
        """
        timed = _timed if self.supports_numpy else _compiled_timed
        profile, minimum = timed(self, _scalar_angle(angle))
        _require_feasible(self, profile, minimum, unit)
        return profile


def _jax_timed(motion_profile: AbstractProfile, total: Scalar) -> tuple[Profile, Scalar]:
    return motion_profile.timed(total)


_compiled_timed = eqx.filter_jit(_jax_timed)
_timed = in_numpy(_jax_timed, _compiled_timed)


def nonzero_size(total: Scalar) -> Scalar:
    """Return |total|, but at least a tiny positive angle, so that limits divided by the result do not overflow."""
    return xp.where(is_nonzero(total), abs(total), _min_angle(total))


def is_nonzero(total: Scalar) -> Flag:
    """Return whether |total| is large enough for a slew of nonzero duration."""
    return abs(total) > _min_angle(total)


def _min_angle(total: Scalar) -> float:
    return float(xp.finfo(total.dtype).eps) ** 2


def _scalar_angle(angle: ArrayInput) -> Scalar:
    """Return the angle of a slew as a finite scalar; raise a ValueError otherwise."""
    total = as_float(angle)
    if total.shape != ():
        raise ValueError(
            f"the angle or distance of a profile must be a scalar, but shape {total.shape} was given. "
            "Use jax.vmap for a batch."
        )
    require_finite(total, "the angle or distance of a profile")
    return total


def limit(value: ArrayInput | None) -> Scalar | None:
    """Return a limit or duration as a floating-point scalar; return None for None or infinity, which mean no limit."""
    if value is None:
        return None
    number = real_scalar(value, "a limit or duration")
    constant = concrete(number)
    return None if constant is not None and constant == math.inf else number


PER_TIME = {"max_rate": "/s", "max_acceleration": "/s²", "max_jerk": "/s³"}
"""The units of the limits, without the unit of the angle or distance."""

END_STATES = ("start_rate", "end_rate", "start_acceleration", "end_acceleration")
"""The rates and accelerations at the ends, of profiles that need not start or end at rest."""


def user_limits(motion_profile: AbstractProfile) -> dict[str, Scalar]:
    """Return the limits and the duration of a motion profile by field name, without values that are None."""
    values = {name: getattr(motion_profile, name, None) for name in (*PER_TIME, "duration")}
    return {name: value for name, value in values.items() if value is not None}


def is_fixed(motion_profile: AbstractProfile) -> bool:
    """Return whether a slew cannot be slowed down, because its duration or one of its end rates is fixed."""
    return motion_profile.duration is not None or has_end_states(motion_profile)


def has_end_states(motion_profile: AbstractProfile) -> bool:
    """Return whether a rate or an acceleration at an end of a motion profile is set."""
    return any(getattr(motion_profile, name, None) is not None for name in END_STATES)


def require_limits(motion_profile: AbstractProfile) -> None:
    """Raise a ValueError if a limit or the duration is neither None nor a positive finite number."""
    for name, value in user_limits(motion_profile).items():
        unit = "s" if name == "duration" else f"rad{PER_TIME[name]} or m{PER_TIME[name]}"
        require_positive(value, name, unit)


def fixed_duration(duration: Scalar, minimum: Scalar, size: Scalar | None = None) -> tuple[Scalar, Flag]:
    """Return `duration` if it is feasible up to round-off, otherwise `minimum`; and whether `duration` is feasible.

    If `minimum` is a difference of larger times, `size` is their size; round-off is relative to it.
    """
    round_off = TOLERANCE * float(xp.finfo(minimum.dtype).eps) * (minimum if size is None else size)
    feasible = (duration >= minimum - round_off) & xp.isfinite(duration)
    return xp.where(feasible, duration, minimum), feasible


def _require_feasible(motion_profile: AbstractProfile, profile: Profile, minimum: Scalar, unit: str) -> None:
    """Raise a ValueError that gives the minimum duration if a fixed duration is concrete and infeasible."""
    feasible = concrete(profile.feasible)
    if feasible is None or feasible:
        return
    angle = f"{float(profile.total):.9g} {unit}".rstrip()
    limits = user_limits(motion_profile)
    if motion_profile.duration is None:
        raise ValueError(f"no motion of {angle} exists between these states: {motion_profile}")
    fixed, minimum_text = float(limits.pop("duration")), f"{float(minimum):.17g} s"
    if fixed < float(minimum):
        units = {name: f" {unit}{per_time}" if unit else "" for name, per_time in PER_TIME.items()}
        bounds = " and ".join(f"{name} = {float(value):.6g}{units[name]}" for name, value in limits.items())
        raise ValueError(
            f"a motion of {angle} with this {motion_profile.name} profile needs at least {minimum_text} within the "
            f"limits ({bounds}), but a duration of {fixed:.9g} s was given. Increase the duration, or raise the limits."
        )
    possible = getattr(motion_profile, "possible_durations", None)
    text = f"The minimum is {minimum_text}; with rates that are not zero, some longer durations are impossible too."
    if possible is not None:
        text = f"It can last {possible(profile.total)}."
    raise ValueError(
        f"with the states at its ends, a motion of {angle} cannot last exactly {fixed:.9g} s with this "
        f"{motion_profile.name} profile within the limits. {text} Change the duration, or the states at the ends."
    )
