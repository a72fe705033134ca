"""What a closed loop did: whether it agrees with its closed form, when it settled, and with what commands."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_quaternion, error_rate
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.quaternion_sign import least_norm
from qtraj.motion.control.response import spectral_abscissa
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.loop_history import LoopHistory
from qtraj.motion.simulation.sensor import AbstractSensor, Sensor
from qtraj.motion.simulation.simulate import NEAR

SETTLED = math.radians(1.0)
"""Within this angle [rad] a loop has settled, unless told otherwise."""
REACHED = 1e-9
"""Relative: a command so near to its limit is limited."""
ACCUMULATED = 100
"""The errors of many steps may add up to this many tolerances of one."""
ROUND_OFF, COARSE = 1e-12, 1e-2
"""Relative: the closed form is met within no less than the first, and by no more than the second."""


class LoopVerdict(AbstractOutcome):
    """A simulated closed loop in numbers, from its instants. NaN stands for what does not exist.

    `initial_angle` and `final_angle` [rad] between body and program; `settled_angle` [rad], and `settling_time` [s]
    from which on the angle stays within it; `peak_command`, the largest length of the physical command [rad/s²; of a
    rate law rad/s], `peak_time` [s], and `peak_components` (3,), its largest component along each body axis.

    `deviation`: the largest difference of the error quaternion from the closed form, over the largest error (and 1);
    `bound`, what the tolerances explain. Both are NaN where there is a `reason` against the closed form.
    `initial_norm`, `least_norm` and `largest_norm` of |λ|, `norm_drift` from what it should be, relative;
    `least_error`, the least |μ|, where the command is largest: `least_error_exact` says that it holds at any time.
    `growth` [1/s], the largest real part of the closed loop's eigenvalues: an error decays where it is negative.
    `code` is that of the solution, or `near_zero_error` where the closed form shows a passage near zero between two
    instants; `instants` is the number of instants.
    """

    initial_angle: Scalar
    final_angle: Scalar
    settled_angle: Scalar
    settling_time: Scalar
    peak_command: Scalar
    peak_time: Scalar
    peak_components: Vec3
    deviation: Scalar
    bound: Scalar
    initial_norm: Scalar
    least_norm: Scalar
    largest_norm: Scalar
    norm_drift: Scalar
    least_error: Scalar
    least_error_exact: Bool[Array, ""]
    growth: Scalar
    code: Int[Array, ""]
    instants: Int[Array, ""]
    reason: str = eqx.field(static=True)
    commands: str = eqx.field(static=True)

    @property
    def applies(self) -> bool:
        """Whether the loop should follow its closed form; `reason` says why not."""
        return not self.reason

    @property
    def agrees(self) -> bool | None:
        """Whether it follows its closed form as closely as the tolerances allow; None where that does not apply."""
        return bool(self.deviation <= self.bound) if self.applies else None

    @property
    def stable(self) -> bool:
        """Whether the gains make every error decay; of the baselines every small one."""
        return bool(self.growth < 0)

    def explain(self, at: tuple[int, ...]) -> str:
        """How the integration ended, and what to do."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        return "finished: every instant was reached." if code == ResultCode.successful else code.text

    def record(self) -> Record:
        """The numbers, and the texts `closed_form` and `result`."""
        per = "rad s-1" if self.commands == "rate" else "rad s-2"
        closed = f"does not apply: {self.reason}" if self.reason else "agrees" if self.agrees else "departs"
        variables = {
            "initial_angle": Quantity(self.initial_angle, "rad", "angle between body and program at the start"),
            "final_angle": Quantity(self.final_angle, "rad", "angle between body and program at the end"),
            "settled_angle": Quantity(self.settled_angle, "rad", "angle within which the loop has settled"),
            "settling_time": Quantity(self.settling_time, "s", "from when on the angle stays within settled_angle"),
            "peak_command": Quantity(self.peak_command, per, "largest length of the physical command"),
            "peak_time": Quantity(self.peak_time, "s", "when it occurs"),
            "peak_components": Quantity(self.peak_components, per, "largest command along each body axis", ("body",)),
            "closed_form": Quantity(np.array(closed), "", "whether the loop follows its closed form, or why not"),
            "deviation": Quantity(self.deviation, "1", "largest difference from the closed form, relative"),
            "bound": Quantity(self.bound, "1", "difference that the tolerances explain"),
            "initial_norm": Quantity(self.initial_norm, "1", "length of the quaternion at the start"),
            "least_norm": Quantity(self.least_norm, "1", "least length of the quaternion"),
            "largest_norm": Quantity(self.largest_norm, "1", "largest length of the quaternion"),
            "norm_drift": Quantity(self.norm_drift, "1", "difference of the length from what it should be, relative"),
            "least_error": Quantity(self.least_error, "1", "least length of the error quaternion"),
            "least_error_exact": Quantity(self.least_error_exact, "1", "whether that holds at any time"),
            "growth": Quantity(self.growth, "s-1", "largest real part of the closed loop's eigenvalues"),
            "stable": Quantity(np.array(self.stable), "1", "whether errors decay"),
            "instants": Quantity(self.instants, "1", "number of instants"),
            "code": Quantity(self.code, "1", "how the integration ended, as a number"),
            "result": Quantity(np.asarray(self.result), "", "how the integration ended"),
        }
        how = "agrees with" if self.agrees else "departs from" if self.applies else "has no"
        settled = (
            f"settled at {float(self.settling_time):.6g} s" if math.isfinite(self.settling_time) else "not settled"
        )
        angles = f"angle {float(self.initial_angle):.6g} to {float(self.final_angle):.6g} rad"
        return Record(f"{angles}, {settled}, {how} its closed form", variables, attributes={"frame": "body"})


def judge_loop(
    history: LoopHistory,
    law: AbstractLaw,
    disturbance: AbstractDisturbance | None = None,
    sensor: AbstractSensor | None = None,
    actuator: Actuator | None = None,
    settled: float = SETTLED,
    rtol: float = 1e-10,
    atol: float = 1e-12,
) -> LoopVerdict:
    """A closed loop in numbers; `law` to `actuator`, `rtol` and `atol` are those of its simulation.

    `settled` [rad] is the angle within which it counts as settled. Only the instants of `history` are looked at: take
    many, and both sides of every jump of the program.
    """
    solution, times = history.solution, history.times
    lengths, angle = np.asarray(solution.norm), np.asarray(solution.angle)
    commands = np.asarray(solution.physical_command)
    known = np.isfinite(commands).all(axis=1)
    sizes = np.linalg.norm(commands, axis=1)
    peak = int(np.argmax(np.where(known, sizes, -1.0)))
    reason = _reason(history, disturbance, sensor, actuator)
    deviation, bound = _deviation(history, rtol, atol) if not reason else (math.nan, math.nan)
    least, exact = _least_error(history, law, reason)
    code = int(solution.code)
    if code == ResultCode.successful and least < NEAR * min(lengths[0], 1.0):
        code = ResultCode.near_zero_error
    anything = known.any()
    return LoopVerdict(
        initial_angle=jnp.asarray(angle[0]),
        final_angle=jnp.asarray(angle[-1]),
        settled_angle=jnp.asarray(settled, float),
        settling_time=solution.settling_time(settled),
        peak_command=jnp.asarray(sizes[peak] if anything else math.nan),
        peak_time=jnp.asarray(times[peak] if anything else math.nan),
        peak_components=jnp.asarray(np.abs(commands[known]).max(axis=0) if anything else np.full(3, np.nan), float),
        deviation=jnp.asarray(deviation, float),
        bound=jnp.asarray(bound, float),
        initial_norm=jnp.asarray(lengths[0]),
        least_norm=jnp.asarray(np.nanmin(lengths) if anything else math.nan),
        largest_norm=jnp.asarray(np.nanmax(lengths) if anything else math.nan),
        norm_drift=jnp.asarray(_drift(history, lengths, reason), float),
        least_error=jnp.asarray(least, float),
        least_error_exact=jnp.asarray(exact),
        growth=jnp.asarray(spectral_abscissa(law), float),
        code=jnp.asarray(int(code), jnp.int32),
        instants=jnp.asarray(len(times)),
        reason=reason,
        commands=solution.commands,
    )


def _reason(
    history: LoopHistory,
    disturbance: AbstractDisturbance | None,
    sensor: AbstractSensor | None,
    actuator: Actuator | None,
) -> str:
    """What makes the loop differ from its closed form; empty for nothing."""
    if history.closed_form is None:
        return "the closed loop of this law is not linear"
    if disturbance is not None:
        return "a disturbance acts on the body"
    if any(part is not None and part.sampling is not None for part in (sensor, actuator)):
        return "the command is held between samples"
    if isinstance(sensor, Sensor) and (np.any(sensor.rate_bias) or np.any(sensor.attitude_bias)):
        return "the sensor has a bias"
    if not bool(history.solution.successful):
        return "the integration did not finish"
    when = _first_limited(history, actuator)
    return "" if when is None else f"the actuator's limit is reached, first at t = {when:.6g} s"


def _first_limited(history: LoopHistory, actuator: Actuator | None) -> float | None:
    if actuator is None or actuator.limit is None:
        return None
    limit, command = np.asarray(actuator.limit), np.asarray(history.solution.physical_command)
    if actuator.saturation == "norm":
        command = np.linalg.norm(command, axis=1, keepdims=True)
    limited = (np.abs(command) >= limit * (1 - REACHED)).any(axis=1)
    return float(history.times[np.argmax(limited)]) if limited.any() else None


def _deviation(history: LoopHistory, rtol: float, atol: float) -> tuple[float, float]:
    """The largest difference from the closed form over the largest error (and 1), and what the tolerances explain."""
    if history.closed_form is None:
        return math.nan, math.nan
    expected = np.asarray(history.closed_form.error)
    deviation = _largest(np.asarray(history.solution.error) - expected) / max(1.0, _largest(expected))
    return deviation, min(ROUND_OFF + ACCUMULATED * (rtol + atol), COARSE)


def _least_error(history: LoopHistory, law: AbstractLaw, reason: str) -> tuple[float, bool]:
    """The least |μ|, where the command is largest: by the closed form at any time, else at the instants."""
    solution, lengths = history.solution, np.asarray(history.solution.norm)
    if not isinstance(law, AccelerationLaw | RateLaw) or np.isnan(lengths).all():
        return math.nan, False
    least = float(np.nanmin(lengths))
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    if reason or kind == "additive" or spectral_abscissa(law) >= 0:
        return least, False
    reference, state = history.reference, (solution.quaternion[0], solution.rate[0])
    start = Attitude(reference.quaternion[0], reference.rate[0], reference.acceleration[0])
    mu, slope = error_quaternion(start, state[0], kind), error_rate(start, *state, kind)
    return min(least, float(least_norm(law, mu, slope))), True


def _drift(history: LoopHistory, lengths: np.ndarray, reason: str) -> float:
    """How far |λ| comes from what it should be, relative to that: from a constant, or from the closed form."""
    if history.closed_form is None:
        return _largest((lengths - lengths[0]) / lengths[0])
    if reason:
        return math.nan
    expected = np.linalg.norm(np.asarray(history.closed_form.quaternion), axis=1)
    return _largest((lengths - expected) / np.maximum(expected, lengths[0]))


def _largest(x: np.ndarray) -> float:
    """The largest length of a row, or magnitude of a number; NaN where one is."""
    return float(np.max(np.linalg.norm(x, axis=1) if x.ndim > 1 else np.abs(x)))
