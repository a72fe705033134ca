"""Define the scenario keys of `qtraj simulate`, and build the closed loop."""

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from pydantic import Field

from qtraj.foundation.naming import naming
from qtraj.foundation.number_text import degrees
from qtraj.foundation.types import Quat
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.control.baselines import BASELINES
from qtraj.motion.control.laws import AbstractLaw
from qtraj.motion.programs.euler_turn import ends_at_rest
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.loop import Loop, renewal_instants
from qtraj.motion.simulation.loop_verdict import SETTLED
from qtraj.motion.simulation.sensor import AbstractSensor
from qtraj.scenario import keys
from qtraj.scenario.body_part import RigidBodyPart
from qtraj.scenario.disturbance_part import DisturbancePart
from qtraj.scenario.keys import ANGLES, NamedPart, Part, key, radians
from qtraj.scenario.loop_parts import ActuatorPart, ErrorPart, FeedbackPart, SensorPart
from qtraj.scenario.program_part import ProgramPart, build_program
from qtraj.scenario.reader import ScenarioFile
from qtraj.scenario.sweep_part import SweepPart

MAX_SAMPLES = 100_000
LONGER = 1e-9
"""Fraction by which a duration may exceed the duration of the program, because users may copy rounded digits."""


class SimulationPart(Part):
    """The times and tolerances of the simulation."""

    duration: keys.Seconds | None = key(
        "simulated time; default: the duration of the program; a longer time requires a program that ends at rest", None
    )
    samples: Annotated[int, Field(ge=2, le=MAX_SAMPLES)] = key(
        "number of instants in the table; the option --samples overrides it",
        601,
        values=f"an integer from 2 to {MAX_SAMPLES}, the number of instants",
    )
    settled: keys.Positive | None = key(
        f"error angle below which the loop counts as settled; default: {degrees(SETTLED)}°", None, unit="angle"
    )
    rtol: Annotated[float, Field(ge=1e-14, le=1e-2)] = key(
        "relative tolerance of a step", 1e-10, values="a number from 1e-14 to 1e-2"
    )
    atol: Annotated[float, Field(ge=1e-16, le=1e-2)] = key(
        "absolute tolerance of a step", 1e-12, values="a number from 1e-16 to 1e-2"
    )


class LoopScenario(NamedPart):
    """A body that follows a program under a feedback law, with optional dynamics, disturbance, sensor and actuator."""

    angles: keys.Angles = key("the unit of angles", values=ANGLES)
    program: ProgramPart = key("the attitude program")
    law: FeedbackPart = key("the feedback law")
    error: ErrorPart = key("the initial error of the body", ErrorPart())
    body: RigidBodyPart | None = key("inertia and wheels; default: the body has the commanded acceleration", None)
    disturbance: DisturbancePart | None = key("an external disturbance", None)
    sensor: SensorPart | None = key("the sensor; default: exact and continuous", None)
    actuator: ActuatorPart | None = key("the actuator; default: unlimited and continuous", None)
    simulation: SimulationPart = key("times and tolerances", SimulationPart())
    sweep: SweepPart | None = key("parameters of a sweep", None)

    def _faults(self) -> Iterator[str]:
        if self.law.kind == "rate" and any(self.error.rate):
            yield "'error.rate' cannot be used with a law of kind 'rate', which commands the rate directly"
        if self.law.kind in BASELINES and "sign" in self.error.model_fields_set:
            yield (
                f"'error.sign' cannot be used with a law of kind '{self.law.kind}', whose command is the same for λ "
                "and −λ"
            )
        if self.law.kind == "rate" and self.body is not None:
            yield "[body] cannot be used with a law of kind 'rate', which commands the rate directly"
        yield from self._inertia_faults()
        yield from self._sampling_faults()

    def _inertia_faults(self) -> Iterator[str]:
        disturbance = self.disturbance
        if disturbance is None or not disturbance.has_torques:
            return
        if disturbance.inertia is not None and self.body is not None:
            yield "the inertia is specified twice: omit 'disturbance.inertia', because [body] has an inertia"
        if disturbance.inertia is None and self.body is None:
            yield (
                "torque and inertia must be specified together, because ε = J⁻¹M: specify 'disturbance.inertia', or "
                "[body] with an inertia"
            )

    def _sampling_faults(self) -> Iterator[str]:
        hysteresis = self.law.hysteresis
        if hysteresis is not None and not any(
            part and part.sampling for part in (hysteresis, self.sensor, self.actuator)
        ):
            yield (
                "the key 'law.hysteresis.sampling' is missing: the sign of λ is updated at samples, so specify this "
                "period, or that of the sensor or of the actuator"
            )


class LoopTask(NamedTuple):
    """The closed loop of a scenario; the fields are arguments of `qtraj.assess_loop`."""

    program: AbstractProgram
    law: AbstractLaw
    quaternion: Quat
    rate: Quat
    times: np.ndarray
    disturbance: AbstractDisturbance | None
    sensor: AbstractSensor | None
    actuator: Actuator | None
    rtol: float
    atol: float
    settled: float
    body: RigidBody | None = None

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.assess_loop`."""
        return self._asdict() | {"sign": "as given"}


def prepare(loaded: ScenarioFile[LoopScenario], samples: int | None = None, frame: str | None = None) -> LoopTask:
    """Build the closed loop of a scenario; `samples` and `frame` override the values of the scenario.

    **Raises:** OSError if a file cannot be read; ValueError for invalid data.
    """
    scenario, simulation = loaded.scenario, loaded.scenario.simulation
    scale = radians(scenario.angles)
    body = scenario.body and scenario.body.body()
    disturbance = scenario.disturbance and scenario.disturbance.disturbance(
        scale, scenario.body and scenario.body.inertia
    )
    sensor = scenario.sensor and scenario.sensor.sensor(scale)
    actuator = scenario.actuator and scenario.actuator.actuator(scale)
    law, program = scenario.law.law(), build_program(scenario.program, loaded.beside, scenario.angles, frame)
    times = _times(scenario, program, samples)
    with naming("[law]: "):  # raises for parts that a rate law cannot have
        loop = Loop(program, law, disturbance, sensor, actuator or Actuator(), body)
    quaternion, rate = scenario.error.state(scenario.angles, program(jnp.asarray(0.0)), law)
    sampled = {"sensor": scenario.sensor, "law.hysteresis": scenario.law.hysteresis}
    first = next((name for name, part in sampled.items() if part is not None and part.sampling), "actuator")
    with naming(f"the key '{first}.sampling': "):  # raises for too many commands
        renewal_instants(loop, jnp.asarray(times))
    settled = SETTLED if simulation.settled is None else scale * simulation.settled
    around = disturbance, sensor, actuator
    return LoopTask(program, law, quaternion, rate, times, *around, simulation.rtol, simulation.atol, settled, body)


def _times(scenario: LoopScenario, program: AbstractProgram, samples: int | None) -> np.ndarray:
    """Return the instants [s] of the table; they may exceed the duration of a program that ends at rest."""
    end = float(program.duration)
    duration = scenario.simulation.duration or end
    if duration <= 0:
        raise ValueError("the program has zero duration: specify simulation.duration [s]")
    if duration > end * (1 + LONGER) and not ends_at_rest(program):
        raise ValueError(
            f"the key 'simulation.duration' has the value {duration:.15g}, but must be at most {end:.15g} s, the "
            "duration of the program: only a slew that ends at rest can be simulated for longer"
        )
    duration = duration if ends_at_rest(program) else min(duration, end)
    return np.linspace(0.0, duration, scenario.simulation.samples if samples is None else samples)
