"""Turn profiles: the angle Φ(t) of a turn about a fixed axis, and the laws that make one from limits or a duration.

A profile is a chain of polynomial pieces, each in its own u = (t − start)/width ∈ [0, 1], so that no power of a time
can overflow or vanish. At a switch the later piece counts. Before its start a turn waits, after its duration it holds.
"""

import abc
import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Polynomial

from qtraj.algebra import polynomial
from qtraj.foundation.arrays import as_float, concrete, one_instant, real_scalar, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Flag, Scalar, ScalarLike

TOLERANCE = 16
"""A fixed duration may be this many machine epsilons (relatively) under the minimal one: that is round-off."""
EQUAL = 1e-9
"""Relative: peaks nearer to each other than this are one, and the first of them counts."""


@storable
class Profile(eqx.Module):
    """The angle of a turn and its derivatives on [0, duration].

    `total` [rad] is reached at `duration` [s]. Piece k runs from `starts[k]` for `widths[k]` seconds and has ascending
    coefficients `pieces[k]` in its own u: of angle/total where the profile is `proportional` (it rests at both ends),
    of the angle otherwise. `end_rate` [rad/s] is the rate at `duration` itself. `feasible` is false only inside a
    trace, where nothing can be raised: the asked duration was impossible, and the nearest possible one was taken.
    """

    total: Scalar = eqx.field(converter=as_float)
    duration: Scalar = eqx.field(converter=as_float)
    starts: Float[Array, " n"] = eqx.field(converter=as_float)
    widths: Float[Array, " n"] = eqx.field(converter=as_float)
    pieces: Float[Array, "n m"] = eqx.field(converter=as_float)
    end_rate: Scalar = eqx.field(converter=as_float)
    feasible: Flag = eqx.field(converter=jnp.asarray)
    proportional: bool = eqx.field(static=True, default=True)

    @property
    def switches(self) -> Float[Array, " n"]:
        """The instants at which a piece ends [s], the last at the duration: `jumps` for an integration."""
        return jnp.concatenate([self.starts[1:], self.duration[None]])

    def angle(self, t: ScalarLike) -> Scalar:
        """Φ(t) [rad]: 0 before the start, `total` after the duration."""
        return self.derivatives(t, 0)[0]

    def rate(self, t: ScalarLike) -> Scalar:
        """Φ̇(t) [rad/s]: `end_rate` at the duration itself, zero after it."""
        return self.derivatives(t, 1)[1]

    def acceleration(self, t: ScalarLike) -> Scalar:
        """Φ̈(t) [rad/s²]: zero from the duration on."""
        return self.derivatives(t, 2)[2]

    def jerk(self, t: ScalarLike) -> Scalar:
        """The third derivative of Φ [rad/s³] between the switches; impulses at a jump of Φ̈ do not show."""
        return self.derivatives(t, 3)[3]

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, " {order}+1"]:
        """Φ and its time derivatives up to `order` at one instant, entry k in [rad s^-k]."""
        return (self.total if self.proportional else 1.0) * self.shape(t, order)

    def shape(self, t: ScalarLike, order: int) -> Float[Array, " {order}+1"]:
        """`derivatives` over `total` where `proportional`, without a division; the same otherwise.

        It is regular at total = 0, so a vector of length `total` times this is smooth in that vector.
        """
        return _shape(self, one_instant(t).astype(self.duration.dtype), order)

    def peak(self, order: int) -> tuple[float, float]:
        """The first instant [s] at which the magnitude of derivative `order` of Φ is largest, and that magnitude.

        Exactly, from the roots of the pieces' derivatives: each piece counts with its own ends, so at a switch both
        sides do. (0, 0) for a turn that takes no time.

        **Raises:** ValueError within a trace, where the profile is not known.
        """
        fields = (self.starts, self.widths, self.pieces)
        if any(concrete(x) is None for x in (*fields, self.total)):
            raise ValueError("the peak of a profile asks for its numbers: call it outside of jax.jit, grad and vmap")
        total = float(self.total) if self.proportional else 1.0
        when, best = 0.0, 0.0
        for start, width, coefficients in zip(*map(np.asarray, fields), strict=True):
            for u, slope in _extremes(coefficients, order) if width > 0 else ():
                with np.errstate(all="ignore"):  # of a width near 0 the derivatives are infinite
                    value = abs(float(total * slope / width**order))
                if value > best * (1 + EQUAL):
                    when, best = float(start + u * width), value
        return when, best


@eqx.filter_jit
def _shape(profile: Profile, t: Scalar, order: int) -> Float[Array, " {order}+1"]:
    after = t >= profile.duration
    outside = after | (t < 0)
    time = jnp.where(outside, 0.0, t)
    # A piece without width ends where it starts, whatever the round-off of the next start says.
    ends = jnp.where(profile.widths[:-1] > 0, profile.starts[1:], profile.starts[:-1])
    piece = jnp.sum(time >= ends)
    start, width, coefficients = profile.starts[piece], profile.widths[piece], profile.pieces[piece]
    width = jnp.where(width > 0, width, 1.0)
    scales = [math.factorial(k) / width**k for k in range(order + 1)]
    inside = polynomial.taylor(coefficients, (time - start) / width, order) * jnp.stack(scales)
    return jnp.where(outside, jnp.where(after, _held(profile, t, order), 0.0), inside)


def _held(profile: Profile, t: Scalar, order: int) -> Float[Array, " {order}+1"]:
    """The shape from the duration on."""
    zero = jnp.zeros_like(t)
    held = [jnp.ones_like(t) if profile.proportional else profile.total]
    if order > 0:
        held.append(jnp.where(t == profile.duration, zero if profile.proportional else profile.end_rate, 0.0))
    return jnp.stack(held + [zero] * (order - 1))


def _extremes(coefficients: np.ndarray, order: int) -> list[tuple[float, np.float64]]:
    """The k-th u-derivative of one piece at u = 0 and 1 and wherever it is stationary in between, with that u."""
    curve = Polynomial(coefficients.astype(float)).deriv(order)
    slope = curve.deriv()
    # Coefficients that no value on [0, 1] shows would make the other roots inexact.
    slope = slope.trim(float(np.finfo(float).eps * np.abs(slope.coef).max()))
    # Of a complex pair the real part is taken as well: one point more does no harm, a double root that is lost may.
    inner = [float(u) for u in np.sort(slope.roots().real) if 0 < u < 1]
    return [(u, np.float64(curve(u))) for u in (0.0, *inner, 1.0)]


class AbstractProfile(eqx.Module):
    """How a turn proceeds in time: what makes the profile for any angle, the shortest or one of a fixed `duration` [s].

    `name` is what messages call it.
    """

    duration: eqx.AbstractVar[Scalar | None]
    name: ClassVar[str]

    @abc.abstractmethod
    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """The profile of a turn by `total` [rad], of either sign, and the least duration [s] within the limits."""

    def profile(self, angle: ArrayInput) -> Profile:
        """The profile of a turn by `angle` [rad], of either sign.

        **Raises:** ValueError for an angle that is not finite, and for a fixed duration in which the angle cannot be
        turned within the limits; inside a trace the profile's `feasible` tells.
        """
        profile, minimal = _timed(self, known_angle(angle))
        require_feasible(self, profile, minimal)
        return profile


@eqx.filter_jit
def _timed(law: AbstractProfile, total: Scalar) -> tuple[Profile, Scalar]:
    return law.timed(total)


def size_of(total: Scalar) -> Scalar:
    """|total|, but never so small that a quotient of limits by it overflows; at and near 0 its gradient is 0."""
    return jnp.where(is_turn(total), jnp.abs(total), _smallest(total))


def is_turn(total: Scalar) -> Flag:
    """Whether the angle is large enough to need any time."""
    return jnp.abs(total) > _smallest(total)


def _smallest(total: Scalar) -> float:
    return float(jnp.finfo(total.dtype).eps) ** 2


def known_angle(angle: ArrayInput) -> Scalar:
    """The angle of a turn as a finite scalar [rad] (ValueError otherwise)."""
    total = as_float(angle)
    if total.shape != ():
        raise ValueError(f"one angle [rad] was expected, but shape {total.shape} was given. Use jax.vmap for many.")
    require_finite(total, "the angle of a turn")
    return total


def limit(value: ArrayInput | None) -> Scalar | None:
    """A limit or duration as a floating scalar; None and infinity are no limit."""
    if value is None:
        return None
    number = real_scalar(value, "a limit or duration")
    known = concrete(number)
    return None if known is not None and known == math.inf else number


UNITS = {"max_rate": "rad/s", "max_acceleration": "rad/s²", "max_jerk": "rad/s³", "duration": "s"}


def given_limits(law: AbstractProfile) -> dict[str, Scalar]:
    """The limits and the duration that a law has, by the names of its fields."""
    found = {name: getattr(law, name, None) for name in UNITS}
    return {name: value for name, value in found.items() if value is not None}


def require_limits(law: AbstractProfile) -> None:
    """Raise a ValueError unless every limit of the law, and its duration, is a positive finite number."""
    for name, value in given_limits(law).items():
        require_positive(value, name, UNITS[name])


def fixed_duration(asked: Scalar, minimal: Scalar) -> tuple[Scalar, Flag]:
    """The duration to use, and whether it is the one asked for: within the limits it is no less than `minimal`."""
    feasible = asked >= minimal * (1 - TOLERANCE * float(jnp.finfo(minimal.dtype).eps))
    return jnp.where(feasible, asked, minimal), feasible


def require_feasible(law: AbstractProfile, profile: Profile, minimal: Scalar) -> None:
    """Raise a ValueError that names the minimal duration where a known profile is not the one that was asked for."""
    known = concrete(profile.feasible)
    if known is None or known or law.duration is None:
        return
    limits = given_limits(law)
    asked = float(limits.pop("duration"))
    turn, given, least = f"{float(profile.total):.9g} rad", f"{asked:.9g} s", f"{float(minimal):.17g} s"
    if asked < float(minimal):
        bounds = " and ".join(f"{name} = {float(value):.6g} {UNITS[name]}" for name, value in limits.items())
        raise ValueError(
            f"a turn by {turn} under this {law.name} law needs at least {least}: in {given} it would break a limit "
            f"({bounds}). Allow more time, or raise the limits."
        )
    raise ValueError(
        f"no turn by {turn} between these end rates takes just {given} within the limits: there is no time to wait "
        f"(the least duration is {least}). Change the duration or the end rates."
    )
