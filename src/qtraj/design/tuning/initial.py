"""The initial path of a tuning."""

import equinox as eqx
import jax
import jax.numpy as jnp

from qtraj.design.limits import Limits
from qtraj.design.tuning.checks import require_choices, require_well_posed
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.motions.registry import get_motion
from qtraj.design.tuning.objectives.nearest import Nearest
from qtraj.design.tuning.objectives.registry import Objective, get_objective
from qtraj.design.tuning.problem import pose
from qtraj.design.tuning.task import as_jax, one
from qtraj.foundation.arrays import as_float
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState, azimuth_difference, cylindrical
from qtraj.path.boundary_problem import directed_turn, whole_turns
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix


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
        any_limit = Limits(speed=1.0)  # the checks require a limit, but the initial path does not depend on limits
        require_choices(start, end, any_limit, objective, motion, duration is not None)
        duration, turn = (None if x is None else as_float(x) for x in (seconds(duration), turn))
        first, last = (jax.tree.map(lambda x: x[None], state) for state in (start, end))
        # The initial path does not depend on the objective, which may be a function of the user.
        kind = objective if objective.is_formula else Nearest()
        problem = pose(first, last, kind, motion, duration, whole_turns(turns), placement, turn)
        require_well_posed(one(problem), turn, any_limit, None, placement is not None)
        path = as_jax(one(problem.path(problem.zero)))
        return path if placement is not None else eqx.tree_at(lambda path: path.placement, path, None)
    if motion.is_uniform or duration is None:
        raise ValueError(
            "boundary accelerations need motion='hermite' and a duration: pass both, or omit the accelerations"
        )
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    short = azimuth_difference(a, b)
    n_turns = round(float(directed_turn(a, b, turns) - short) / (2 * jnp.pi))
    return SpiralHelix.hermite(start, end, as_float(duration), n_turns, placement)
