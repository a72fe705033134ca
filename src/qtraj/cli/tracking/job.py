"""From a scenario of `qtraj track` to the arguments of `simulate`."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.cli.tracking.program import holds, program_jumps, program_of
from qtraj.foundation.types import Quat
from qtraj.io.attitude_part import radians
from qtraj.io.feedback_part import LINEAR, FeedbackPart
from qtraj.io.plant_part import ActuatorPart, DisturbancePart, ErrorPart, SensorPart
from qtraj.io.scenario import ScenarioFile
from qtraj.io.tracking_model import TrackingScenario
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control import gains
from qtraj.motion.control.baselines import GeometricFeedback, LogarithmicFeedback, QuaternionFeedback
from qtraj.motion.control.errors import error_quaternion
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.quaternion_sign import HALF_TURN, place
from qtraj.motion.programs.euler_turn import EulerTurn
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import (
    AbstractDisturbance,
    DisturbanceAcceleration,
    DisturbanceTorque,
    Sinusoid,
)
from qtraj.motion.simulation.loop import Loop, renewal_instants
from qtraj.motion.simulation.sensor import AbstractSensor, Gyros, Sensor

BASELINES = {"quaternion": QuaternionFeedback, "geometric": GeometricFeedback, "logarithmic": LogarithmicFeedback}
LONGER = 1e-9
"""Relative: a duration so much longer than the program is that of the program, written with fewer digits."""


@dataclass(frozen=True)
class Job:
    """A closed loop that is ready to run: the arguments of `simulate` besides its times, and what was chosen.

    `times` (n,) [s] are the instants of the table; `renewals` [s] those of new commands, None for a continuous loop.
    """

    program: AbstractProgram
    law: AbstractLaw
    quaternion: Quat
    rate: Quat
    times: np.ndarray
    jumps: np.ndarray | None
    renewals: np.ndarray | None
    disturbance: AbstractDisturbance | None
    sensor: AbstractSensor | None
    actuator: Actuator | None
    rtol: float
    atol: float
    flipped: bool


def prepare(given: ScenarioFile[TrackingScenario], samples: int | None = None, frame: str | None = None) -> Job:
    """The closed loop of a scenario; `samples` and `frame` go before those that the scenario asks for.

    **Raises:** OSError for a file that cannot be read; ValueError for data that make no loop.
    """
    scenario = given.scenario
    scale = radians(scenario.angles)
    program = program_of(given, frame)
    times = _times(scenario, program, samples)
    with _naming("[law]: "):
        law = feedback_law(scenario.law)
    quaternion, rate, flipped = _initial(scenario.error, scenario.angles, program(jnp.asarray(0.0)), law)
    disturbance = None if scenario.disturbance is None else _disturbance(scenario.disturbance, scale)
    sensor = None if scenario.sensor is None else _sensor(scenario.sensor, scale)
    actuator = None if scenario.actuator is None else _actuator(scenario.actuator, scale)
    with _naming(f"the key '{_sampling_key(scenario)}': "):
        loop = Loop(program, law, disturbance, sensor, Actuator() if actuator is None else actuator)
        renewals = renewal_instants(loop, jnp.asarray(times))
    return Job(
        program=program,
        law=law,
        quaternion=quaternion,
        rate=rate,
        times=times,
        jumps=program_jumps(program),
        renewals=None if renewals is None else np.asarray(renewals),
        disturbance=disturbance,
        sensor=sensor,
        actuator=actuator,
        rtol=scenario.simulation.rtol,
        atol=scenario.simulation.atol,
        flipped=flipped,
    )


def feedback_law(part: FeedbackPart) -> AbstractLaw:
    """The law of a table [law]."""
    if part.kind == "rate":
        if part.settling_time is not None:
            return RateLaw(gains.rate_from_settling_time(part.settling_time, part.residual))
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
    mu = part.unit_quaternion(angles)
    mu = jnp.asarray([1.0, 0.0, 0.0, 0.0]) if mu is None else mu
    if part.gauge == "gibbs" and abs(float(mu[0])) < HALF_TURN:
        raise ValueError("error.gauge = 'gibbs' is not possible at a half turn, which has no Gibbs vector")
    excess = radians(angles) * jnp.asarray(part.rate)
    quaternion, rate = place(law, start, mu, excess, part.sign, part.gauge)
    return quaternion, rate, float(error_quaternion(start, quaternion)[0]) < 0


def _times(scenario: TrackingScenario, program: AbstractProgram, samples: int | None) -> np.ndarray:
    own = float(program.duration)
    duration = scenario.simulation.duration
    if duration is None:
        if own <= 0:
            raise ValueError("the program takes no time: give simulation.duration [s]")
        duration = own
    if duration > own and not holds(program):
        if duration > own * (1 + LONGER):
            moving = ", still turning" if isinstance(program, EulerTurn) else ""
            raise ValueError(
                f"the key 'simulation.duration' holds {duration:.15g}, but expected no more than {own:.15g} s: this "
                f"program ends there{moving}"
            )
        duration = own
    return np.linspace(0.0, duration, scenario.simulation.samples if samples is None else samples)


def _sampling_key(scenario: TrackingScenario) -> str:
    sampled = scenario.sensor is not None and scenario.sensor.sampling is not None
    return "sensor.sampling" if sampled else "actuator.sampling"


def _disturbance(part: DisturbancePart, scale: float) -> AbstractDisturbance:
    amplitude = part.torque if part.acceleration is None else [scale * x for x in part.acceleration]
    course: Any = jnp.asarray(amplitude, float)
    if part.period is not None:
        course = Sinusoid(course, part.period, scale * part.phase)
    if part.acceleration is not None:
        return DisturbanceAcceleration(course)
    with _naming("the key 'disturbance.inertia': "):
        return DisturbanceTorque(course, jnp.asarray(part.inertia, float))


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


@contextmanager
def _naming(where: str) -> Iterator[None]:
    """Say where in the scenario the cause of a ValueError stands."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}{error}") from error
