"""Assess a simulated closed loop: agreement with its closed form, settling, commands and stability."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from qtraj.foundation.devices import of_one_device
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_quaternion, error_rate
from qtraj.motion.control.hysteresis import HystereticLaw, without_hysteresis
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.quaternion_sign import least_norm
from qtraj.motion.control.response import spectral_abscissa
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.loop_history import LoopHistory
from qtraj.motion.simulation.sensor import AbstractSensor, Sensor
from qtraj.motion.simulation.simulate import NEAR

SETTLED = math.radians(1.0)
"""Default angle [rad] below which a loop counts as settled."""
LIMITED = 1e-9
"""A command counts as limited if it is below the limit by at most this fraction of the limit."""
STEPS = 100
"""Largest expected accumulated error, as a multiple of the sum of the tolerances `rtol` and `atol` of a step."""
MIN_BOUND, MAX_BOUND = 1e-12, 1e-2
"""Range of the bound on the relative deviation from the closed form."""


class LoopVerdict(AbstractOutcome):
    """The assessment of a simulated closed loop; values that are not defined are NaN.

    - `initial_angle`, `final_angle` [rad]: the angle between the body and the program at the first and the last
      instant.
    - `settling_time` [s]: the time after which the angle stays within `settled_angle` [rad].
    - `peak_command`: the largest magnitude of the physical command [rad/s²; rad/s for a rate law], at `peak_time` [s].
      `peak_components` (3,): the largest absolute value of the command about each body axis.
    - `deviation`: the largest difference between the error quaternion and its closed form, divided by the larger of 1
      and the largest norm of the closed form. `bound`: the largest deviation that the tolerances explain. Both are NaN
      if the closed form does not apply; `reason` says why.
    - `initial_norm`, `least_norm`, `largest_norm`: the initial, smallest and largest |λ|. `norm_drift`: the largest
      relative error of |λ|.
    - `least_error`: the minimum of |μ|; the command is large where |μ| is small. `least_error_exact`: whether
      `least_error` is the minimum over continuous time, from the closed form, instead of the minimum over the instants.
    - `growth` [1/s]: the largest real part of the closed-loop eigenvalues; errors decay if it is negative.
    - `code`: the code of the solution, or `near_zero_error` if the closed form is near zero between two instants.
    - `instants`: the number of instants.
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
        """Whether the closed form applies to the loop; if it does not, `reason` says why."""
        return not self.reason

    @property
    def agrees(self) -> bool | None:
        """Whether the deviation from the closed form is within `bound`; None if the closed form does not apply."""
        return bool(self.deviation <= self.bound) if self.applies else None

    @property
    def stable(self) -> bool:
        """Whether errors decay with these gains; for the baseline laws, whether small errors decay."""
        return bool(self.growth < 0)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result of the integration, with advice."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        return "finished: every instant was reached." if code == ResultCode.successful else code.text

    def record(self) -> Record:
        """Return the fields with units, and the strings `closed_form` and `result`."""
        per = "rad s-1" if self.commands == "rate" else "rad s-2"
        closed = f"does not apply: {self.reason}" if self.reason else "agrees" if self.agrees else "departs"
        variables = {
            "initial_angle": Quantity(self.initial_angle, "rad", "angle between body and program at the start"),
            "final_angle": Quantity(self.final_angle, "rad", "angle between body and program at the end"),
            "settled_angle": Quantity(self.settled_angle, "rad", "angle below which the loop counts as settled"),
            "settling_time": Quantity(self.settling_time, "s", "time after which the angle stays within settled_angle"),
            "peak_command": Quantity(self.peak_command, per, "largest magnitude of the physical command"),
            "peak_time": Quantity(self.peak_time, "s", "time of the largest command"),
            "peak_components": Quantity(self.peak_components, per, "largest command about each body axis", ("body",)),
            "closed_form": Quantity(np.array(closed), "", "whether the closed form agrees, or why it does not apply"),
            "deviation": Quantity(self.deviation, "1", "largest relative difference from the closed form"),
            "bound": Quantity(self.bound, "1", "largest deviation that the tolerances explain"),
            "initial_norm": Quantity(self.initial_norm, "1", "norm of the quaternion at the start"),
            "least_norm": Quantity(self.least_norm, "1", "smallest norm of the quaternion"),
            "largest_norm": Quantity(self.largest_norm, "1", "largest norm of the quaternion"),
            "norm_drift": Quantity(self.norm_drift, "1", "relative error of the norm of the quaternion"),
            "least_error": Quantity(self.least_error, "1", "smallest norm of the error quaternion"),
            "least_error_exact": Quantity(
                self.least_error_exact, "1", "whether least_error is the minimum over continuous time"
            ),
            "growth": Quantity(self.growth, "s-1", "largest real part of the closed loop's eigenvalues"),
            "stable": Quantity(np.array(self.stable), "1", "whether errors decay"),
            "instants": Quantity(self.instants, "1", "number of instants"),
            "code": Quantity(self.code, "1", "result code of the integration"),
            "result": Quantity(np.asarray(self.result), "", "description of the result"),
        }
        how = "agrees with" if self.agrees else "deviates from" if self.applies else "has no"
        settled = (
            f"settled at {float(self.settling_time):.6g} s" if math.isfinite(self.settling_time) else "not settled"
        )
        angles = f"angle {float(self.initial_angle):.6g} to {float(self.final_angle):.6g} rad"
        return Record(f"{angles}, {settled}, {how} its closed form", variables, attributes={"frame": "body"})


@of_one_device
def judge_loop(
    history: LoopHistory,
    law: AbstractLaw,
    disturbance: AbstractDisturbance | None = None,
    sensor: AbstractSensor | None = None,
    actuator: Actuator | None = None,
    settled: float = SETTLED,
    rtol: float = 1e-10,
    atol: float = 1e-12,
    *,
    body: RigidBody | None = None,
) -> LoopVerdict:
    """Assess a simulated closed loop.

    `law`, `disturbance`, `sensor`, `actuator`, `rtol`, `atol` and `body` are the arguments of the simulation. `settled`
    [rad] is the angle below which the loop counts as settled. Only the instants of `history` are used, so these
    instants should be dense and include both sides of each jump of the program, as the instants of `judging_times` do.
    """
    solution, times = history.solution, history.times
    lengths, angle = np.asarray(solution.norm), np.asarray(solution.angle)
    commands = np.asarray(solution.physical_command)
    finite = np.isfinite(commands).all(axis=1)
    sizes = np.linalg.norm(commands, axis=1)
    peak = int(np.argmax(np.where(finite, sizes, -1.0)))
    reason = _reason(history, law, disturbance, sensor, actuator, body)
    deviation, bound = _deviation(history, rtol, atol) if not reason else (math.nan, math.nan)
    least, exact = _least_error(history, law, reason)
    code = int(solution.code)
    if code == ResultCode.successful and least < NEAR * min(lengths[0], 1.0):
        code = ResultCode.near_zero_error
    any_finite = finite.any()
    return LoopVerdict(
        initial_angle=jnp.asarray(angle[0]),
        final_angle=jnp.asarray(angle[-1]),
        settled_angle=jnp.asarray(settled, float),
        settling_time=solution.settling_time(settled),
        peak_command=jnp.asarray(sizes[peak] if any_finite else math.nan),
        peak_time=jnp.asarray(times[peak] if any_finite else math.nan),
        peak_components=jnp.asarray(np.abs(commands[finite]).max(axis=0) if any_finite else np.full(3, np.nan), float),
        deviation=jnp.asarray(deviation, float),
        bound=jnp.asarray(bound, float),
        initial_norm=jnp.asarray(lengths[0]),
        least_norm=jnp.asarray(np.nanmin(lengths) if any_finite else math.nan),
        largest_norm=jnp.asarray(np.nanmax(lengths) if any_finite else math.nan),
        norm_drift=jnp.asarray(_drift(history, law, lengths, reason), float),
        least_error=jnp.asarray(least, float),
        least_error_exact=jnp.asarray(exact),
        growth=jnp.asarray(spectral_abscissa(without_hysteresis(law)), float),
        code=jnp.asarray(int(code), jnp.int32),
        instants=jnp.asarray(len(times)),
        reason=reason,
        commands=solution.commands,
    )


def _reason(
    history: LoopHistory,
    law: AbstractLaw,
    disturbance: AbstractDisturbance | None,
    sensor: AbstractSensor | None,
    actuator: Actuator | None,
    body: RigidBody | None,
) -> str:
    """Return the reason why the closed form does not apply, or an empty string if the closed form applies."""
    if isinstance(law, HystereticLaw):
        return "a hysteretic law may change the sign of λ"
    if history.closed_form is None:
        return "the closed loop of this law is not linear"
    if body is not None and not np.array_equal(body.inertia, body.assumed):
        return "the law assumes another inertia than that of the body"
    if disturbance is not None or (body is not None and body.torque is not None):
        return "a disturbance acts on the body"
    if any(part is not None and part.sampling is not None for part in (sensor, actuator)):
        return "the command is held between samples"
    if isinstance(sensor, Sensor) and (np.any(sensor.rate_bias) or np.any(sensor.attitude_bias)):
        return "the sensor has a bias"
    if actuator is not None and actuator.time_constant is not None:
        return "the actuator follows the command with a lag"
    if not bool(history.solution.successful):
        return "the integration did not finish"
    if (t := _first_limited(history, actuator)) is not None:
        return f"the actuator's limit is reached, first at t = {t:.6g} s"
    solution = history.solution
    t = None if solution.body is None else solution.body.first_mismatch(solution.physical_command, solution.rate)
    return "" if t is None else f"a limit of the torques is reached, first at t = {t:.6g} s"


def _first_limited(history: LoopHistory, actuator: Actuator | None) -> float | None:
    """Return the first instant [s] at which the command is limited, or None if the command is never limited."""
    if actuator is None or actuator.limit is None:
        return None
    limit, command = np.asarray(actuator.limit), np.asarray(history.solution.physical_command)
    if actuator.saturation == "norm":
        command = np.linalg.norm(command, axis=1, keepdims=True)
    limited = (np.abs(command) >= limit * (1 - LIMITED)).any(axis=1)
    return float(history.times[np.argmax(limited)]) if limited.any() else None


def _deviation(history: LoopHistory, rtol: float, atol: float) -> tuple[float, float]:
    """Return the `deviation` from the closed form and the `bound` of a `LoopVerdict`."""
    if history.closed_form is None:
        return math.nan, math.nan
    expected = np.asarray(history.closed_form.error)
    deviation = _largest(np.asarray(history.solution.error) - expected) / max(1.0, _largest(expected))
    return deviation, min(MIN_BOUND + STEPS * (rtol + atol), MAX_BOUND)


def _least_error(history: LoopHistory, law: AbstractLaw, reason: str) -> tuple[float, bool]:
    """Return the minimum of |μ|, and whether it is the minimum over continuous time instead of over the instants."""
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


def _drift(history: LoopHistory, law: AbstractLaw, lengths: np.ndarray, reason: str) -> float:
    """Return the largest relative difference of |λ| from its closed form, or from |λ(0)| if the law keeps |λ|.

    The result is NaN if the law changes |λ| and the closed form does not apply to the loop.
    """
    if history.closed_form is None and not isinstance(without_hysteresis(law), AccelerationLaw):
        return _largest((lengths - lengths[0]) / lengths[0])
    if reason or history.closed_form is None:
        return math.nan
    expected = np.linalg.norm(np.asarray(history.closed_form.quaternion), axis=1)
    return _largest((lengths - expected) / np.maximum(expected, lengths[0]))


def _largest(x: np.ndarray) -> float:
    """Return the largest norm of the rows, or the largest absolute value of a vector; NaN if a value is NaN."""
    return float(np.max(np.linalg.norm(x, axis=1) if x.ndim > 1 else np.abs(x)))
