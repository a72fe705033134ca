"""From a scenario of `qtraj track` to the arguments of `simulate`."""

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.cli.tracking.program import holds, program_jumps, program_of
from qtraj.foundation.types import Flag, Quat, Scalar, Vec3
from qtraj.io.attitude_part import radians
from qtraj.io.feedback_part import LINEAR, FeedbackPart
from qtraj.io.plant_part import ActuatorPart, DisturbancePart, ErrorPart, SensorPart
from qtraj.io.scenario import ScenarioFile
from qtraj.io.tracking_model import TrackingScenario
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control import gains
from qtraj.motion.control.baselines import GeometricFeedback, LogarithmicFeedback, QuaternionFeedback
from qtraj.motion.control.errors import state_from_error
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.sheet import choose_sign, gibbs_gauge
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import AbstractDisturbance, DisturbanceAcceleration, DisturbanceTorque
from qtraj.motion.simulation.sensor import AbstractSensor, Gyros, Sensor

BASELINES = {"quaternion": QuaternionFeedback, "geometric": GeometricFeedback, "logarithmic": LogarithmicFeedback}
HALF_TURN = 1e-6
"""A Gibbs vector is refused where the scalar part of the error is smaller."""


class Sinusoid(eqx.Module):
    """amplitude·sin(2πt/period + phase)."""

    amplitude: Vec3
    period: float
    phase: float

    def __call__(self, t: Scalar) -> Vec3:
        return self.amplitude * jnp.sin(2 * math.pi * t / self.period + self.phase)


@dataclass(frozen=True)
class Job:
    """A closed loop that is ready to run; the arguments of `simulate`, and what was chosen at the start."""

    program: AbstractProgram
    law: AbstractLaw
    quaternion: Quat
    rate: Quat
    times: np.ndarray
    jumps: np.ndarray | None
    disturbance: AbstractDisturbance | None
    sensor: AbstractSensor | None
    actuator: Actuator | None
    rtol: float
    atol: float
    flipped: bool


def prepare(given: ScenarioFile[TrackingScenario]) -> Job:
    """The closed loop of a scenario.

    **Raises:** OSError for a file that cannot be read; ValueError, naming the scenario, for data that make no loop.
    """
    scenario = given.scenario
    try:
        return _prepare(given, scenario)
    except ValueError as error:
        raise ValueError(f"{given.file}: {error}") from error


def _prepare(given: ScenarioFile[TrackingScenario], scenario: TrackingScenario) -> Job:
    program = program_of(given)
    law = feedback_law(scenario.law)
    scale = radians(scenario.angles)
    start = program(jnp.asarray(0.0))
    quaternion, rate, flipped = _initial(scenario.error, scenario.angles, start, law)
    return Job(
        program=program,
        law=law,
        quaternion=quaternion,
        rate=rate,
        times=_times(scenario, program),
        jumps=program_jumps(program),
        disturbance=None if scenario.disturbance is None else _disturbance(scenario.disturbance, scale),
        sensor=None if scenario.sensor is None else _sensor(scenario.sensor, scale),
        actuator=None if scenario.actuator is None else _actuator(scenario.actuator, scale),
        rtol=scenario.simulation.rtol,
        atol=scenario.simulation.atol,
        flipped=flipped,
    )


def feedback_law(part: FeedbackPart) -> AbstractLaw:
    """The law of a table [law]."""
    if part.kind == "rate":
        if part.settling_time is not None:
            return RateLaw(-math.log(part.residual) / part.settling_time)
        return RateLaw(jnp.asarray(part.k, float))
    k1, k2 = _gains(part)
    return AccelerationLaw(k1, k2, part.kind) if part.kind in LINEAR else BASELINES[part.kind](k1, k2)


def _gains(part: FeedbackPart) -> tuple[Any, Any]:
    if part.settling_time is not None:
        return gains.from_settling_time(part.settling_time, part.residual)
    if part.damping is not None and part.frequency is not None:
        return gains.from_damping(part.damping, part.frequency)
    if part.weights is not None:
        return gains.from_weights(part.weights.error, part.weights.rate, part.weights.command)
    return jnp.asarray(part.k1, float), jnp.asarray(part.k2, float)


def _initial(part: ErrorPart, angles: str, start: Attitude, law: AbstractLaw) -> tuple[Quat, Quat, bool]:
    """λ and ω at the start, and whether the far one of ±λ was taken."""
    error = part.unit_quaternion(angles)
    error = jnp.asarray([1.0, 0.0, 0.0, 0.0]) if error is None else error
    if part.gauge == "gibbs" and abs(float(error[0])) < HALF_TURN:
        raise ValueError("error.gauge = 'gibbs' is not possible at a half turn, which has no Gibbs vector")
    excess = radians(angles) * jnp.asarray(part.rate)
    quaternion, rate, far = _placed(law, start, error, excess, part.sign, part.gauge)
    return quaternion, rate, bool(far)


@eqx.filter_jit
def _placed(
    law: AbstractLaw, start: Attitude, error: Quat, excess: Vec3, sign: str, gauge: str
) -> tuple[Quat, Quat, Flag]:
    """The state with this error, and a rate that exceeds the program's, under the choices of sign and gauge."""
    near = jnp.where(error[0] < 0, -error, error)
    quaternion, rate = state_from_error(start, near, jnp.zeros_like(near))
    rate = rate.at[1:].add(excess).at[0].set(0.0)
    chosen = quaternion
    if sign == "far":
        chosen = -quaternion
    elif sign == "auto" and isinstance(law, AccelerationLaw | RateLaw):
        chosen = choose_sign(law, start, quaternion, rate)
    if gauge == "gibbs":
        return *gibbs_gauge(start, chosen, rate), jnp.asarray(False)
    return chosen, rate, chosen @ quaternion < 0


def _times(scenario: TrackingScenario, program: AbstractProgram) -> np.ndarray:
    own = float(program.duration)
    duration = scenario.simulation.duration
    if duration is None:
        if own <= 0:
            raise ValueError("the program takes no time: give simulation.duration [s]")
        duration = own
    if duration > own and not holds(program):
        raise ValueError(
            f"the key 'simulation.duration' holds {duration:g}, but expected no more than {own:.6g} s: this program "
            "ends there"
        )
    return np.linspace(0.0, duration, scenario.simulation.samples)


def _disturbance(part: DisturbancePart, scale: float) -> AbstractDisturbance:
    amplitude = part.torque if part.acceleration is None else [scale * x for x in part.acceleration]
    course: Any = jnp.asarray(amplitude, float)
    if part.period is not None:
        course = Sinusoid(course, part.period, scale * part.phase)
    return (
        DisturbanceAcceleration(course)
        if part.acceleration
        else DisturbanceTorque(course, jnp.asarray(part.inertia, float))
    )


def _sensor(part: SensorPart, scale: float) -> AbstractSensor:
    rate_bias, attitude_bias = (scale * np.array(bias) for bias in (part.rate_bias, part.attitude_bias))
    rate_noise, attitude_noise = scale * part.rate_noise, scale * part.attitude_noise
    key = jax.random.key(part.seed) if rate_noise or attitude_noise else None
    if part.kind == "gyros" and part.sampling is not None:
        return Gyros(part.sampling, rate_bias, rate_noise, attitude_bias, key)
    return Sensor(rate_bias, rate_noise, attitude_bias, attitude_noise, part.sampling, key)


def _actuator(part: ActuatorPart, scale: float) -> Actuator:
    limit = None if part.limit is None else scale * np.asarray(part.limit, float)
    return Actuator(limit, part.saturation, part.sampling)
