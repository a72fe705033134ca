"""Define the scenario keys of `qtraj simulate`, and build the closed loop."""

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from pydantic import AfterValidator, Field

from qtraj.foundation.naming import naming
from qtraj.foundation.number_text import degrees
from qtraj.foundation.types import Quat
from qtraj.io.input_file import read_input
from qtraj.io.saved import saved_path, saved_program
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.control.baselines import BASELINES
from qtraj.motion.control.laws import AbstractLaw
from qtraj.motion.programs.euler_turn import SlewSequence, ends_at_rest
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.rotation_minimizing import Frame, frame_named, name_of
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.loop import Loop, renewal_instants
from qtraj.motion.simulation.loop_verdict import SETTLED
from qtraj.motion.simulation.sensor import AbstractSensor
from qtraj.path.existence import require_defined
from qtraj.path.frame_axes import FRAMES, UPRIGHT
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import AbstractFrame, Upright
from qtraj.scenario import keys
from qtraj.scenario.keys import ANGLES, NamedPart, Part, key, one_of, radians, with_hyphens
from qtraj.scenario.loop_parts import ActuatorPart, DisturbancePart, ErrorPart, FeedbackPart, SensorPart
from qtraj.scenario.path import lay
from qtraj.scenario.reader import ScenarioFile, scenario_in
from qtraj.scenario.slew import SlewPart
from qtraj.scenario.spin import SpinPart

MAX_SAMPLES = 100_000
SOURCES = "[program.slew], [program.spin], path = 'a path scenario or a saved path', or file = 'a saved program'"
LONGER = 1e-9
"""Fraction by which a duration may exceed the duration of the program, because users may copy rounded digits."""


class ProgramPart(Part):
    """The attitude program: a slew, a spin, the frame of a path, or a saved program."""

    slew: SlewPart | None = key("a slew within limits", None, values="a table [program.slew]")
    spin: SpinPart | None = key("a rotation at a constant rate", None, values="a table [program.spin]")
    path: keys.Text | None = key(
        "a path; the program is the attitude of a frame along it",
        None,
        values="the name of a path scenario or a saved path, relative to the scenario",
    )
    frame: Annotated[str, one_of(FRAMES), AfterValidator(with_hyphens)] | None = key(
        "frame of the path: 'upright' (x forward, y left, z up; the default), 'natural' (tangent, principal normal, "
        "binormal; flips at inflections of the path), 'rotation-minimizing' (zero rate about the tangent) or "
        "'thrust-aligned' (z along the thrust, for multirotors)",
        None,
    )
    up: keys.Vector | None = key("up direction of the upright frame; default: [0, 0, 1]", None)
    heading: keys.Number | None = key(
        "heading of the thrust-aligned frame, from world x towards world y; default: along the velocity",
        None,
        unit="angle",
    )
    file: keys.Text | None = key(
        "a saved program, such as program.toml from `qtraj slew`",
        None,
        values="the name of a saved program, relative to the scenario",
    )

    def _faults(self) -> Iterator[str]:
        sources = self.given("slew", "spin", "path", "file")
        if len(sources) != 1:
            problem = f"there are several programs ({', '.join(sources)})" if sources else "there is no program"
            yield f"{problem}: specify one of {SOURCES}"
        if self.path is None and (extra := self.given("frame", "up", "heading")):
            yield f"the key '{extra[0]}' requires a program along a path: add path in [program], or remove the key"
        self.path_frame("rad")  # raises for settings of another frame

    def describe(self, program: AbstractProgram) -> str:
        """Describe the program as text."""
        if self.path is not None:
            return f"{name_of(program.frame if isinstance(program, FrameProgram) else Upright())} frame of {self.path}"
        if self.spin is not None:
            return "spin"
        if self.file is not None:
            return f"{type(program).__name__} of {self.file}"
        return "sequence of slews" if isinstance(program, SlewSequence) else "slew"

    def path_frame(self, angles: str, chosen: str | None = None) -> Frame:
        """Return the frame of the path; a `chosen` frame overrides the frame of the scenario."""
        own = self.frame or UPRIGHT
        if chosen not in (None, own):
            return frame_named(chosen)
        return frame_named(own, self.up, None if self.heading is None else radians(angles) * self.heading)

    def along(self, path: SpiralHelix, chosen: str | None, angles: str) -> FrameProgram:
        """Return the frame of a path as a program; a `chosen` frame overrides the frame of the scenario."""
        frame = self.path_frame(angles, chosen)
        if isinstance(frame, AbstractFrame):
            with naming("[program]: " if chosen is None else "--frame: "):
                require_defined(path, frame)
        return FrameProgram(path, frame)


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
    """A body that follows a program under a feedback law, with an optional disturbance, sensor and actuator."""

    angles: keys.Angles = key("the unit of angles", values=ANGLES)
    program: ProgramPart = key("the attitude program")
    law: FeedbackPart = key("the feedback law")
    error: ErrorPart = key("the initial error of the body", ErrorPart())
    disturbance: DisturbancePart | None = key("an external disturbance", None)
    sensor: SensorPart | None = key("the sensor; default: exact and continuous", None)
    actuator: ActuatorPart | None = key("the actuator; default: unlimited and continuous", None)
    simulation: SimulationPart = key("times and tolerances", SimulationPart())

    def _faults(self) -> Iterator[str]:
        if self.law.kind == "rate" and any(self.error.rate):
            yield "'error.rate' cannot be used with a law of kind 'rate', which commands the rate directly"
        if self.law.kind in BASELINES and "sign" in self.error.model_fields_set:
            yield (
                f"'error.sign' cannot be used with a law of kind '{self.law.kind}', whose command is the same for λ "
                "and −λ"
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

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.assess_loop`."""
        return self._asdict() | {"sign": "as given"}


def prepare(loaded: ScenarioFile[LoopScenario], samples: int | None = None, frame: str | None = None) -> LoopTask:
    """Build the closed loop of a scenario; `samples` and `frame` override the values of the scenario.

    **Raises:** OSError if a file cannot be read; ValueError for invalid data.
    """
    scenario, simulation = loaded.scenario, loaded.scenario.simulation
    scale = radians(scenario.angles)
    disturbance = scenario.disturbance and scenario.disturbance.disturbance(scale)
    sensor = scenario.sensor and scenario.sensor.sensor(scale)
    actuator = scenario.actuator and scenario.actuator.actuator(scale)
    law, program = scenario.law.law(), _program(loaded, frame)
    times = _times(scenario, program, samples)
    with naming("[law]: "):  # raises for parts that a rate law cannot have
        loop = Loop(program, law, disturbance, sensor, actuator or Actuator())
    quaternion, rate = scenario.error.state(scenario.angles, program(jnp.asarray(0.0)), law)
    sampled = sensor is not None and sensor.sampling is not None
    with naming(f"the key '{'sensor' if sampled else 'actuator'}.sampling': "):  # raises for too many commands
        renewal_instants(loop, jnp.asarray(times))
    settled = SETTLED if simulation.settled is None else scale * simulation.settled
    around = disturbance, sensor, actuator
    return LoopTask(program, law, quaternion, rate, times, *around, simulation.rtol, simulation.atol, settled)


def _program(loaded: ScenarioFile[LoopScenario], frame: str | None) -> AbstractProgram:
    part, angles = loaded.scenario.program, loaded.scenario.angles
    if frame is not None and part.path is None:
        raise ValueError(
            f"--frame {frame} requires a program along a path, but [program] has no path: add path in [program], or "
            "omit --frame"
        )
    if part.slew is not None:
        with naming("in [program.slew], "):
            return part.slew.program_within_limits(angles)
    if part.spin is not None:
        return part.spin.program(angles)
    if part.path is None:
        return saved_program(loaded.beside(str(part.file)))
    given = read_input(loaded.beside(part.path))
    path = saved_path(given.file) if given.is_saved else lay(scenario_in(given, "path")).path
    return part.along(path, frame, angles)


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
