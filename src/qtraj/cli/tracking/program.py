"""The program that `qtraj track` follows."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.cli.tuning.job import is_saved, lay, saved_path
from qtraj.cli.turning.job import SMOOTH, turn_program
from qtraj.io.attitude_part import radians
from qtraj.io.scenario import ScenarioFile, read_scenario
from qtraj.io.scenario_model import Scenario
from qtraj.io.scenario_part import given as given_keys
from qtraj.io.stored import load
from qtraj.io.tracking_model import ProgramPart, TrackingScenario
from qtraj.io.turn_model import LIMITS, NEEDED, TurnPart
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.rotation_minimizing import RotationMinimizing, name_of
from qtraj.motion.programs.slew_torque import within_torque
from qtraj.path.frame_axes import MINIMIZING, NATURAL, THRUST_ALIGNED, UPRIGHT
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.thrust_aligned import ThrustAligned
from qtraj.path.trihedral import AbstractFrame, Natural, Upright, trihedral

CHECKED = 257
"""Equally spaced instants at which a frame must exist."""


WHY = {NATURAL: "no motion, or no bend", UPRIGHT: "no motion, or straight up or down"}
WHY |= {THRUST_ALIGNED: "no motion, free fall, or thrust along the velocity or the heading"}
OTHERS = {NATURAL: "'upright' or 'rotation-minimizing'", UPRIGHT: "'natural' or 'rotation-minimizing'"}
OTHERS |= {THRUST_ALIGNED: OTHERS[NATURAL]}
"""Where a frame does not exist, and which others may."""


def program_of(given: ScenarioFile[TrackingScenario], frame: str | None = None) -> AbstractProgram:
    """The program of a scenario; `frame` goes before that of the scenario.

    **Raises:** OSError for a file that cannot be read; ValueError for data that make no program.
    """
    part = given.scenario.program
    if frame is not None and part.path is None:
        raise ValueError(f"--frame {frame} belongs to a program along a path, [program] path, and there is none")
    if part.turn is not None:
        return _turn(part.turn, given.scenario.angles)
    if part.path is not None:
        return _framed(_path(given.beside(part.path)), part, frame, given.scenario.angles)
    return _saved(given.beside(str(part.file)))


def holds(program: AbstractProgram) -> bool:
    """Whether the program comes to rest at its end: then it may be followed for longer."""
    if isinstance(program, EulerTurn):
        return float(program.profile.end_rate) == 0
    return isinstance(program, SlewSequence)


def program_jumps(program: AbstractProgram) -> np.ndarray | None:
    """The instants at which the program's acceleration may jump [s]; None for none."""
    return np.unique(program.switches) if isinstance(program, EulerTurn | SlewSequence) else None


def described(part: ProgramPart, program: AbstractProgram) -> str:
    """What the program is, in words."""
    if part.path is not None:
        along = program.frame if isinstance(program, FrameProgram) else Upright()
        return f"{name_of(along)} frame of {part.path}"
    if part.file is not None:
        return f"{type(program).__name__} of {part.file}"
    return "chain of turns" if isinstance(program, SlewSequence) else "turn"


def _turn(part: TurnPart, angles: str) -> EulerTurn | SlewSequence:
    """The program of a turn that keeps every limit given, also one of a fixed duration."""
    try:
        program = turn_program(part, angles)
        limits = {name: radians(angles) * getattr(part.law, name) for name in given_keys(part.law, *LIMITS)}
        if limits and part.law.duration is not None and part.law.kind not in NEEDED:
            law = SMOOTH[part.law.kind](duration=part.law.duration, **limits)
            for angle in np.atleast_1d(program.angle if isinstance(program, EulerTurn) else program.angles):
                law.profile(angle)  # which tells what is broken
        if part.body is not None and part.body.max_torque is not None:
            program = within_torque(program, part.body.inertia, part.body.max_torque)
    except ValueError as error:
        raise ValueError(f"in [program.turn], {error}") from error
    return program


def _path(file: Path) -> SpiralHelix:
    return saved_path(file) if is_saved(file) else lay(read_scenario(file, Scenario)).path


def _framed(path: SpiralHelix, part: ProgramPart, chosen: str | None, angles: str) -> FrameProgram:
    name = (chosen or part.frame or UPRIGHT).replace("_", "-")
    if name == MINIMIZING:
        return FrameProgram(path, RotationMinimizing())
    frame = _frame(name, part, angles)
    times = jnp.linspace(0.0, path.duration, CHECKED)
    defined = np.asarray(_defined(path, frame, times))
    if not defined.all():
        when = float(times[int(np.argmin(defined))])
        raise ValueError(
            f"the {name} frame of this path does not exist at t = {when:.6g} s ({WHY[name]}): take frame = "
            f"{OTHERS[name]}, or --frame with one of them"
        )
    return FrameProgram(path, frame)


def _frame(name: str, part: ProgramPart, angles: str) -> AbstractFrame:
    if name == THRUST_ALIGNED:
        return ThrustAligned(None if part.heading is None else radians(angles) * part.heading)
    return Natural() if name == NATURAL else Upright() if part.up is None else Upright(part.up)


def _saved(file: Path) -> AbstractProgram:
    stored = load(file)
    if not isinstance(stored, AbstractProgram):
        raise ValueError(f"{file}: a saved program was expected, but the file holds a {type(stored).__name__}")
    return stored


@eqx.filter_jit
def _defined(path: SpiralHelix, frame: AbstractFrame, times: Float[Array, " n"]) -> Bool[Array, " n"]:
    return jax.vmap(lambda t: trihedral(path, t, frame).defined)(times)
