"""The initial path of a tuning."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from qtraj.design.limits import Limits
from qtraj.design.tuning.checks import fault_codes, require_choices, require_well_posed
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.motions.registry import get_motion
from qtraj.design.tuning.objectives.nearest import Nearest
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.objectives.registry import Objective, get_objective
from qtraj.design.tuning.problem import Problem, pose
from qtraj.design.tuning.task import as_jax, one
from qtraj.foundation.arrays import as_float
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState, azimuth_difference, cylindrical
from qtraj.path.boundary_problem import directed_turn, whole_turns
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

ANY_LIMIT = Limits(speed=1.0)
"""The checks require a limit, but the initial path does not depend on limits."""


def initial_path(
    start: BoundaryState,
    end: BoundaryState,
    objective: Objective = "nearest",
    motion: str | AbstractMotion = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: ArrayInput | None = None,
) -> SpiralHelix:
    """Return the path with which `tune` starts if it is called with the same arguments.

    With "uniform" motion the angular rate is constant and equals the turn divided by `duration`. Without a `duration`,
    it is the rate that fits V_φ at both ends best in the least-squares sense. With "hermite" motion the path has the
    given boundary velocities. If a `duration` is also given, the states may contain accelerations, and the path has
    these accelerations at its ends. `tune` does not accept states with accelerations.

    **Raises:** ValueError if the arguments do not determine a path.
    """
    objective, motion = get_objective(objective), get_motion(motion)
    if start.acceleration is None and end.acceleration is None:
        first, last = (jax.tree.map(lambda x: x[None], state) for state in (start, end))
        turn = None if turn is None else as_float(turn)
        problem = _posed(first, last, objective, motion, duration, turns, placement, turn)
        require_well_posed(one(problem), turn, ANY_LIMIT, None, placement is not None)
        return _placed(as_jax(one(problem.path(problem.zero))), placement)
    if motion.is_uniform or duration is None:
        raise ValueError(
            "boundary accelerations need motion='hermite' and a duration: pass both, or omit the accelerations"
        )
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    short = azimuth_difference(a, b)
    n_turns = round(float(directed_turn(a, b, turns) - short) / (2 * jnp.pi))
    return SpiralHelix.hermite(start, end, as_float(duration), n_turns, placement)


def initial_paths(
    start: BoundaryState,
    end: BoundaryState,
    objective: Objective = "nearest",
    motion: str | AbstractMotion = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
) -> tuple[SpiralHelix, Int[np.ndarray, " n"]]:
    """Return the initial paths of a batch of problems between states without accelerations, and their `fault_codes`.

    The path of an ill-posed problem has no meaning.

    **Raises:** ValueError if the arguments contradict each other.
    """
    objective, motion = get_objective(objective), get_motion(motion)
    problem = _posed(start, end, objective, motion, duration, turns, placement, None)
    with np.errstate(all="ignore"):
        codes = np.asarray(fault_codes(problem, None, ANY_LIMIT, None, placement is not None))
        return _placed(problem.path(problem.zero), placement), codes


def _posed(
    start: BoundaryState,
    end: BoundaryState,
    objective: AbstractObjective,
    motion: AbstractMotion,
    duration: ArrayInput | None,
    turns: int,
    placement: Placement | None,
    turn: ArrayInput | None,
) -> Problem:
    require_choices(start, end, ANY_LIMIT, objective, motion, duration is not None)
    duration = None if (time := seconds(duration)) is None else as_float(time)
    # The initial path does not depend on the objective, which may be a function of the user.
    kind = objective if objective.is_formula else Nearest()
    return pose(start, end, kind, motion, duration, whole_turns(turns), placement, turn)


def _placed(path: SpiralHelix, placement: Placement | None) -> SpiralHelix:
    return path if placement is not None else eqx.tree_at(lambda path: path.placement, path, None)
