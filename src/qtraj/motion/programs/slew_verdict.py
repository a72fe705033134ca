"""Whether a slew meets its limits: peaks against limits, the least duration, and the sign of the end attitude."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra import quaternion
from qtraj.foundation.arrays import real_vector
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.profiles.profile import AbstractProfile, user_limits
from qtraj.motion.profiles.smooth_step import Cubic
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_history import Leg, slew_legs
from qtraj.motion.programs.slew_torque import peak_torque, within_torque

ORDERS = {"max_rate": 1, "max_acceleration": 2, "max_jerk": 3}
"""The derivative of the angle that each limit bounds."""
UNITS = {"max_rate": "rad s-1", "max_acceleration": "rad s-2", "max_jerk": "rad s-3"}
TORQUE_UNIT = "N m"
WITHOUT_JERK = (TimeOptimal, Cubic)
"""Laws whose acceleration jumps, during the slew or at its ends: no jerk limit can hold."""
TOLERANCE = 1e-9
"""Relative: a limit is broken by more than this, and active where the peak is nearer to it."""

MET, BROKEN, NO_LIMIT = STATUSES = ("met", "broken", "no limit")


class SlewVerdict(AbstractResult):
    """A slew, or a sequence of slews, against its limits.

    Over `names`, such as "max_rate" or "max_torque": `peaks`, the largest magnitudes, and `times` [s], when each first
    occurs; `limits`, NaN where there is none. Over the slews of the program: `starts` and `durations` [s], `angles`
    [rad], and unit vectors `body_axes` and `inertial_axes` (m, 3), NaN where nothing moves. `switches` [s] are the
    instants at which the laws pass from one piece to the next. `least_duration` [s] is that of the fastest slew found
    within the limits, NaN where the law has no fixed duration or no limit. `end` (4,) is the quaternion at which the
    program ends; `sign` is −1 where that is the wanted one with the other sign.
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

    @property
    def status(self) -> dict[str, str]:
        """Whether each limit is "met", "broken" or "no limit", by its name."""
        rows = zip(self.names, np.asarray(self.peaks).tolist(), np.asarray(self.limits).tolist(), strict=True)
        return {name: NO_LIMIT if math.isnan(b) else BROKEN if v > b * (1 + TOLERANCE) else MET for name, v, b in rows}

    @property
    def active(self) -> list[str]:
        """Names of the limits that are met with nothing to spare (a relative margin below 1e-9)."""
        peaks, limits = np.asarray(self.peaks), np.asarray(self.limits)
        return [self.names[k] for k in np.flatnonzero(np.abs(peaks - limits) <= TOLERANCE * limits)]

    @property
    def met(self) -> bool:
        """Whether no limit is broken."""
        return BROKEN not in self.status.values()

    @property
    def duration(self) -> float:
        """The duration of the whole program [s]."""
        return float(self.starts[-1] + self.durations[-1])

    @property
    def result(self) -> str:
        """The verdict in words, with what to do where a limit is broken."""
        if np.isnan(self.body_axes).all():
            return "there is nothing to turn: all attitudes are the same."
        least, status = float(self.least_duration), self.status
        if not self.met:
            exceeded = np.asarray(self.peaks) / np.asarray(self.limits) - 1
            worst = [f"{x} by {100 * exceeded[k]:.3g} %" for k, x in enumerate(self.names) if status[x] == BROKEN]
            within = "" if math.isnan(least) else f" Within the limits it takes {least:.9g} s or more."
            return f"limits are broken: {', '.join(worst)}.{within} Allow more time, or raise the limits."
        if active := self.active:
            listed = " and ".join(filter(None, [", ".join(active[:-1]), active[-1]]))
            return f"all limits are met; {listed} {'binds' if len(active) == 1 else 'bind'}."
        if all(text == NO_LIMIT for text in status.values()):
            return "there are no limits to meet."
        spare = "" if math.isnan(least) or least == 0 else f" The slew could be over in {least:.9g} s."
        return f"all limits are met, with room to spare.{spare}"

    def record(self) -> Record:
        """Peaks over `limit`, whose coordinate `limit_unit` has the unit of each; the slews over `slew`."""
        limit, slew = ("limit",), ("slew",)
        margin = np.asarray(self.limits) - np.asarray(self.peaks)
        active = np.isin(self.names, self.active)
        units = np.array([UNITS.get(name, TORQUE_UNIT) for name in self.names])
        variables = {
            "peak": Quantity(self.peaks, "", "largest magnitude, in limit_unit", limit),
            "peak_time": Quantity(self.times, "s", "when it first occurs", limit),
            "bound": Quantity(self.limits, "", "the limit, in limit_unit; NaN for none", limit),
            "margin": Quantity(margin, "", "limit less peak, in limit_unit", limit),
            "status": Quantity(np.array(list(self.status.values())), "", f"one of {', '.join(STATUSES)}", limit),
            "active": Quantity(active, "1", "whether the limit is met with nothing to spare", limit),
            "start": Quantity(self.starts, "s", "start of each slew", slew),
            "duration": Quantity(self.durations, "s", "duration of each slew", slew),
            "angle": Quantity(self.angles, "rad", "angle of each slew", slew),
            "axis_body": Quantity(self.body_axes, "1", "axis of each slew, body axes", ("slew", "body")),
            "axis_inertial": Quantity(self.inertial_axes, "1", "axis of each slew, inertial axes", ("slew", "world")),
            "switch_time": Quantity(self.switches, "s", "when the laws pass from one piece to the next", ("switch",)),
            "least_duration": Quantity(self.least_duration, "s", "duration of the fastest slew within the limits"),
            "end_quaternion": Quantity(self.end, "1", "attitude at the end", ("component",)),
            "end_sign": Quantity(self.sign, "1", "its sign against the wanted quaternion"),
            "met": Quantity(np.array(self.met), "1", "whether no limit is broken"),
            "result": Quantity(np.array(self.result), "", "the verdict in words"),
        }
        coordinates = {
            "limit": Quantity(np.array(self.names), "", "what is limited", limit),
            "limit_unit": Quantity(units, "", "its unit", limit),
        }
        found = ", ".join(f"{name} {text}" for name, text in self.status.items())
        turned = f"{math.degrees(float(np.sum(self.angles))):.6g}° in {self.duration:.6g} s"
        return Record(f"{turned}: {found}", variables, coordinates, {"frame": "body"})


def judge_slew(
    program: EulerTurn | SlewSequence,
    limits: Mapping[str, ArrayInput] | None = None,
    inertia: ArrayInput | None = None,
    max_torque: ArrayInput | None = None,
    end: ArrayInput | None = None,
) -> SlewVerdict:
    """A slew, or a sequence of slews, against limits on the angle's derivatives and on the torque.

    `limits`: "max_rate", "max_acceleration" and "max_jerk" [rad s⁻ᵏ], by name; without them those of the program's law.
    `inertia` [kg m²], as in `peak_torque`, adds the torque, and `max_torque` [N m] its limit: a number for its length,
    (3,) for each component in body axes. `end` (4,) is the wanted end attitude, whose sign is compared; without it that
    of the program. The peaks are exact: those of polynomials between the switches. To keep a torque limit the fastest
    slew is slowed down as `within_torque` does it, and another one may be shorter.

    **Raises:** ValueError for a program of another kind, unknown limits, an inertia that is none, a `max_torque`
    without inertia, or inside a trace.
    """
    legs, law = slew_legs(program), program.law
    given = _limits(law, limits)
    rows = [(name, *_peak(legs, ORDERS[name]), given.get(name)) for name in ORDERS]
    if isinstance(law, WITHOUT_JERK):
        rows.pop()
    if inertia is not None:
        rows += _torques(program, inertia, max_torque)
    elif max_torque is not None:
        raise ValueError("max_torque was given without the inertia of the body: pass inertia [kg m²] as well")
    names, peaks, times, bounds = zip(*rows, strict=True)
    last = legs[-1].turn
    wanted = last.end_q if end is None else real_vector(end, "the end attitude", 4)
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
        least_duration=jnp.asarray(_least_duration(program, given, inertia, max_torque)),
        end=last.end,
        sign=jnp.where(quaternion.unit(wanted) @ last.end < 0, -1, 1),
    )


def _limits(law: AbstractProfile, limits: Mapping[str, ArrayInput] | None) -> dict[str, float]:
    if unknown := [name for name in limits or {} if name not in ORDERS]:
        raise ValueError(f"unknown limit {unknown[0]!r} of a slew; known are {', '.join(ORDERS)}")
    known = user_limits(law) if limits is None else limits
    return {name: float(np.asarray(value)) for name, value in known.items() if name in ORDERS}


def _peak(legs: Sequence[Leg], order: int) -> tuple[float, float]:
    """The largest magnitude of a derivative of the angle, and the first instant of it [s]."""
    best, when = 0.0, legs[0].start
    for leg in legs:
        time, value = leg.profile.peak(order)
        if value > best * (1 + TOLERANCE):
            best, when = value, leg.start + time
    return best, when


def _torques(program: EulerTurn | SlewSequence, inertia: ArrayInput, limit: ArrayInput | None) -> list[tuple[Any, ...]]:
    """The largest torque, of its length or, where each axis has its limit, of the components."""
    peak = peak_torque(program, inertia)
    if limit is None or np.ndim(limit) == 0:
        return [("max_torque", peak.norm, peak.norm_time, None if limit is None else float(np.asarray(limit)))]
    each = zip("xyz", peak.axes, peak.axes_times, np.asarray(limit, float).tolist(), strict=True)
    return [(f"max_torque_{axis}", value, time, bound) for axis, value, time, bound in each]


def _axes(legs: Sequence[Leg], axes: str) -> Float[Array, "m 3"]:
    return jnp.stack([leg.turn.axis(axes) if leg.moves else jnp.full(3, jnp.nan) for leg in legs])


def _least_duration(
    program: EulerTurn | SlewSequence,
    limits: dict[str, float],
    inertia: ArrayInput | None,
    max_torque: ArrayInput | None,
) -> float:
    """The duration of the same slew by a law that takes the least time within the limits [s]; NaN without any."""
    law = program.law
    if law.duration is None or not limits:
        return math.nan
    fastest = dataclasses.replace(program, law=dataclasses.replace(law, duration=None, **limits))
    resting = getattr(law, "start_rate", None) is None and getattr(law, "end_rate", None) is None
    if inertia is not None and max_torque is not None and resting:
        fastest = within_torque(fastest, inertia, max_torque)
    return float(fastest.duration)
