"""Compare a slew with its limits: peaks, active limits, minimum duration, and sign of the final quaternion."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.polynomial import Polynomial

from qtraj.algebra import quaternion
from qtraj.foundation.arrays import real_vector, require_concrete
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.profiles.profile import AbstractProfile, is_fixed, user_limits
from qtraj.motion.profiles.smooth_step import Cubic
from qtraj.motion.profiles.stationary import stationary_points
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_advice import advice
from qtraj.motion.programs.slew_history import Leg, slew_legs
from qtraj.motion.programs.slew_peak_torque import peak_torque
from qtraj.motion.programs.slew_torque import within_torque

ORDERS = {"max_rate": 1, "max_acceleration": 2, "max_jerk": 3}
"""For each limit, the order of the time derivative of the angle that it bounds."""
UNITS = {"max_rate": "rad s-1", "max_acceleration": "rad s-2", "max_jerk": "rad s-3"}
TORQUE_UNIT = "N m"
WITHOUT_JERK = (TimeOptimal, Cubic)
"""Profiles for which no jerk is compared, because their acceleration jumps."""
TOLERANCE = 1e-9
"""Relative tolerance of the comparison of peaks with limits.

A limit is violated if the peak exceeds it by more than the tolerance, and active if the peak and the limit differ by at
most the tolerance.
"""

MET, BROKEN, NO_LIMIT = STATUSES = ("met", "broken", "no limit")


class SlewVerdict(AbstractResult):
    """The comparison of a slew, or of a sequence of slews, with its limits.

    - `names`: the n limited quantities, such as "max_rate" or "max_torque". For each quantity, `peaks` is the largest
      magnitude, `times` [s] the first instant of the peak, and `limits` the limit (NaN for no limit).
    - `starts`, `durations` [s] and `angles` [rad] of the m slews, and their unit axes in body and inertial axes,
      `body_axes` and `inertial_axes` (m, 3). An axis is NaN if the attitude does not change.
    - `switches` (k,) [s]: the instants between two segments of a profile.
    - `least_duration` [s]: the duration of the fastest slew within the limits; NaN if the profile does not have a fixed
      duration or if there are no limits.
    - `overshoots` (m,) [rad]: how far each slew goes beyond its start or its end, because of end rates.
    - `advice`: changes of the profile with which the limits are satisfied; they have been computed.
    - `end` (4,): the quaternion at the end of the program. `sign` is −1 if `end` and the requested quaternion have
      opposite signs, otherwise 1.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    peaks: Float[Array, " n"]
    times: Float[Array, " n"]
    limits: Float[Array, " n"]
    starts: Float[Array, " m"]
    durations: Float[Array, " m"]
    angles: Float[Array, " m"]
    body_axes: Float[Array, "m 3"]
    inertial_axes: Float[Array, "m 3"]
    switches: Float[Array, " k"]
    least_duration: Scalar
    end: Quat
    sign: Int[Array, ""]
    overshoots: Float[Array, " m"]
    advice: str = eqx.field(static=True)

    @property
    def status(self) -> dict[str, str]:
        """The status of each limit by its name: "met", "broken" or "no limit"."""
        rows = zip(self.names, np.asarray(self.peaks).tolist(), np.asarray(self.limits).tolist(), strict=True)
        return {name: NO_LIMIT if math.isnan(b) else BROKEN if v > b * (1 + TOLERANCE) else MET for name, v, b in rows}

    @property
    def active(self) -> list[str]:
        """The names of the active limits; a limit is active if |peak − limit| is at most 1e-9 of the limit."""
        peaks, limits = np.asarray(self.peaks), np.asarray(self.limits)
        return [self.names[k] for k in np.flatnonzero(np.abs(peaks - limits) <= TOLERANCE * limits)]

    @property
    def met(self) -> bool:
        """Whether all limits are satisfied."""
        return BROKEN not in self.status.values()

    @property
    def duration(self) -> float:
        """The duration of the whole program [s]."""
        return float(self.starts[-1] + self.durations[-1])

    @property
    def result(self) -> str:
        """A description of the result, with advice if a limit is violated, and a slew that overshoots its end."""
        return " ".join(filter(None, (self._comparison, self._overshoot)))

    @property
    def _overshoot(self) -> str:
        """A text about the slew that goes furthest beyond its ends; empty if there is none."""
        k = int(np.argmax(self.overshoots))
        beyond, angle = math.degrees(float(self.overshoots[k])), math.degrees(float(self.angles[k]))
        if not beyond:
            return ""
        return (
            f"The slew of {angle:.6g}° goes {beyond:.6g}° beyond its ends and returns, because its limits do not allow "
            "faster changes of the rates and accelerations at its ends."
        )

    @property
    def _comparison(self) -> str:
        """A description of the limits that are violated or active."""
        if np.isnan(self.body_axes).all():
            return "there is no slew, because all attitudes are the same."
        minimum, status = float(self.least_duration), self.status
        if not self.met:
            exceeded = np.asarray(self.peaks) / np.asarray(self.limits) - 1
            worst = [f"{x} by {100 * exceeded[k]:.3g} %" for k, x in enumerate(self.names) if status[x] == BROKEN]
            least = "" if math.isnan(minimum) else f"Within the limits, the slew takes at least {minimum:.9g} s."
            return " ".join(filter(None, (f"limits are violated: {', '.join(worst)}.", least, self.advice)))
        if active := self.active:
            listed = " and ".join(filter(None, [", ".join(active[:-1]), active[-1]]))
            return f"all limits are met; {listed} {'is' if len(active) == 1 else 'are'} active."
        if all(text == NO_LIMIT for text in status.values()):
            return "there are no limits."
        least = "" if math.isnan(minimum) or minimum == 0 else f" The slew could be completed in {minimum:.9g} s."
        return f"all limits are met, and none is active.{least}"

    def record(self) -> Record:
        """Return the peaks along `limit`, with units in the coordinate `limit_unit`, and the slews along `slew`."""
        limit, slew = ("limit",), ("slew",)
        margin = np.asarray(self.limits) - np.asarray(self.peaks)
        active = np.isin(self.names, self.active)
        units = np.array([UNITS.get(name, TORQUE_UNIT) for name in self.names])
        variables = {
            "peak": Quantity(self.peaks, "", "largest magnitude, in limit_unit", limit),
            "peak_time": Quantity(self.times, "s", "first instant of the peak", limit),
            "bound": Quantity(self.limits, "", "the limit, in limit_unit; NaN for none", limit),
            "margin": Quantity(margin, "", "limit minus peak, in limit_unit", limit),
            "status": Quantity(np.array(list(self.status.values())), "", f"one of {', '.join(STATUSES)}", limit),
            "active": Quantity(active, "1", "whether the limit is active", limit),
            "start": Quantity(self.starts, "s", "start of each slew", slew),
            "duration": Quantity(self.durations, "s", "duration of each slew", slew),
            "angle": Quantity(self.angles, "rad", "angle of each slew", slew),
            "axis_body": Quantity(self.body_axes, "1", "axis of each slew, body axes", ("slew", "body")),
            "axis_inertial": Quantity(self.inertial_axes, "1", "axis of each slew, inertial axes", ("slew", "world")),
            "overshoot": Quantity(self.overshoots, "rad", "how far each slew goes beyond its start or its end", slew),
            "switch_time": Quantity(self.switches, "s", "instants between two segments of a profile", ("switch",)),
            "least_duration": Quantity(self.least_duration, "s", "duration of the fastest slew within the limits"),
            "end_quaternion": Quantity(self.end, "1", "attitude quaternion at the end", ("component",)),
            "end_sign": Quantity(self.sign, "1", "sign relative to the requested quaternion"),
            "met": Quantity(np.array(self.met), "1", "whether all limits are satisfied"),
            "result": Quantity(np.array(self.result), "", "description of the result"),
        }
        coordinates = {
            "limit": Quantity(np.array(self.names), "", "limited quantity", limit),
            "limit_unit": Quantity(units, "", "unit of the limited quantity", limit),
        }
        statuses = ", ".join(f"{name} {text}" for name, text in self.status.items())
        slewed = f"{math.degrees(float(np.sum(self.angles))):.6g}° in {self.duration:.6g} s"
        return Record(f"{slewed}: {statuses}", variables, coordinates, {"frame": "body"})


@of_one_device
def judge_slew(
    program: EulerTurn | SlewSequence,
    limits: Mapping[str, ArrayInput] | None = None,
    inertia: ArrayInput | None = None,
    max_torque: ArrayInput | None = None,
    end: ArrayInput | None = None,
) -> SlewVerdict:
    """Compare a slew, or a sequence of slews, with limits on the derivatives of the angle and on the torque.

    `limits`: a dictionary with the keys "max_rate" [rad/s], "max_acceleration" [rad/s²] and "max_jerk" [rad/s³]; None
    for the limits of the program's profile. With an `inertia` [kg m²], as in `peak_torque`, the peak torque is computed
    too. `max_torque` [N m] is the limit of the torque: a number for its magnitude, (3,) for each component in body
    axes. `end` (4,): the requested final quaternion; None for the `end_q` of the program. The sign of `end` is compared
    with the sign of the program's final quaternion.

    The peaks are maxima of polynomials, exact up to rounding errors. For the minimum duration with a torque limit,
    `within_torque` slows down the fastest slew within the other limits; a slew with another profile may be faster. If
    the profile has end rates, the minimum duration does not account for the torque limit.

    **Raises:** ValueError for a program that is neither an `EulerTurn` nor a `SlewSequence`, unknown limits, an invalid
    inertia, a `max_torque` without an inertia, or inside a trace.
    """
    require_concrete("judge_slew", program, limits, inertia, max_torque, end)
    legs, law = slew_legs(program), program.law
    user_bounds = _limits(law, limits)
    rows = [(name, *_peak(legs, ORDERS[name]), user_bounds.get(name)) for name in ORDERS]
    if isinstance(law, WITHOUT_JERK):
        rows.pop()
    if inertia is not None:
        rows += _torques(program, inertia, max_torque)
    elif max_torque is not None:
        raise ValueError("max_torque needs the inertia of the body: pass inertia [kg m²] too")
    names, peaks, times, bounds = zip(*rows, strict=True)
    factors = [(peak / bound) ** (1 / ORDERS.get(name, 2)) for name, peak, _, bound in rows if bound is not None]

    def is_met(other: EulerTurn | SlewSequence) -> bool:
        return judge_slew(other, user_bounds, inertia, max_torque, end).met

    violated = any(bound is not None and peak > bound * (1 + TOLERANCE) for _, peak, _, bound in rows)
    remedies = advice(program, user_bounds, inertia, max_torque, max(factors), is_met) if violated else ""
    last = legs[-1].turn
    requested = last.end_q if end is None else real_vector(end, "the end attitude", 4)
    return SlewVerdict(
        names=names,
        peaks=jnp.asarray(peaks, float),
        times=jnp.asarray(times, float),
        limits=jnp.asarray([np.nan if bound is None else bound for bound in bounds], float),
        starts=jnp.asarray([leg.start for leg in legs]),
        durations=jnp.asarray([float(leg.profile.duration) for leg in legs]),
        angles=jnp.asarray([float(leg.profile.total) for leg in legs]),
        body_axes=_axes(legs, "body"),
        inertial_axes=_axes(legs, "inertial"),
        switches=jnp.asarray([t for leg in legs for t in leg.switches], float),
        least_duration=jnp.asarray(_least_duration(program, user_bounds, inertia, max_torque)),
        end=last.end,
        sign=jnp.where(quaternion.unit(requested) @ last.end < 0, -1, 1),
        overshoots=jnp.asarray([_beyond(leg) for leg in legs], float),
        advice=remedies,
    )


def _limits(law: AbstractProfile, limits: Mapping[str, ArrayInput] | None) -> dict[str, float]:
    if unknown := [name for name in limits or {} if name not in ORDERS]:
        raise ValueError(f"unknown limit {unknown[0]!r}: the limits of a slew are {', '.join(ORDERS)}")
    bounds = user_limits(law) if limits is None else limits
    return {name: float(np.asarray(value)) for name, value in bounds.items() if name in ORDERS}


def _peak(legs: Sequence[Leg], order: int) -> tuple[float, float]:
    """Return the largest magnitude of a time derivative of the angle, and the first instant [s] at which it occurs."""
    best, instant = 0.0, legs[0].start
    for leg in legs:
        time, value = leg.profile.peak(order)
        if value > best * (1 + TOLERANCE):
            best, instant = value, leg.start + time
    return best, instant


def _beyond(leg: Leg) -> float:
    """Return how far [rad] the angle of a slew goes below 0 or above the angle of its end; 0 for round-off."""
    profile = leg.profile
    if profile.proportional:
        return 0.0
    values = [
        float(curve(u))
        for curve in map(Polynomial, np.asarray(profile.pieces, float)[np.asarray(profile.widths) > 0])
        for u in stationary_points(curve)
    ]
    total = float(profile.total)
    beyond = max(max(values, default=0.0) - max(total, 0.0), min(total, 0.0) - min(values, default=0.0))
    return beyond if beyond > TOLERANCE * max(map(abs, values), default=0.0) else 0.0


def _torques(program: EulerTurn | SlewSequence, inertia: ArrayInput, limit: ArrayInput | None) -> list[tuple[Any, ...]]:
    """Return name, peak, instant [s] and limit of the torque, or of its components if each axis has a limit."""
    peak = peak_torque(program, inertia)
    if limit is None or np.ndim(limit) == 0:
        return [("max_torque", peak.norm, peak.norm_time, None if limit is None else float(np.asarray(limit)))]
    components = zip("xyz", peak.axes, peak.axes_times, np.asarray(limit, float).tolist(), strict=True)
    return [(f"max_torque_{axis}", value, time, bound) for axis, value, time, bound in components]


def _axes(legs: Sequence[Leg], axes: str) -> Float[Array, "m 3"]:
    return jnp.stack([leg.turn.axis(axes) if leg.moves else jnp.full(3, jnp.nan) for leg in legs])


def _least_duration(
    program: EulerTurn | SlewSequence,
    limits: dict[str, float],
    inertia: ArrayInput | None,
    max_torque: ArrayInput | None,
) -> float:
    """Return the minimum duration [s] of the slew within the limits.

    The result is NaN if the duration of the slew is not fixed, or if there are no limits.
    """
    law = program.law
    if law.duration is None or not limits:
        return math.nan
    try:
        fastest = dataclasses.replace(program, law=dataclasses.replace(law, duration=None, **limits))
    except ValueError:  # the limits forbid the state at an end
        return math.nan
    if inertia is not None and max_torque is not None and not is_fixed(fastest.law):
        fastest = within_torque(fastest, inertia, max_torque)
    return float(fastest.duration)
