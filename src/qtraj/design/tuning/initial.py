"""The path that tuning starts from."""

import equinox as eqx
import jax.numpy as jnp

from qtraj.design.limits import Limits
from qtraj.design.tuning.checks import require_choices, require_sound
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.motions.registry import motion_of
from qtraj.design.tuning.objectives.registry import Objective, objective_of
from qtraj.design.tuning.problem import Problem, pose
from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState, azimuth_difference, cylindrical
from qtraj.path.boundary_problem import directed_turn, whole_turns
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix


def given_path(
    start: BoundaryState,
    end: BoundaryState,
    objective: Objective = "nearest",
    motion: str | AbstractMotion = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: ArrayInput | None = None,
) -> SpiralHelix:
    """The path between two states before anything is tuned: the one from which `tune` with these arguments starts.

    For "uniform" motion it turns at the rate nearest to both V_φ/ρ, which need not agree; "hermite" meets all given
    velocities, and, with a duration, given accelerations (which `tune` would refuse).

    **Raises:** ValueError for input that makes no path, saying what was given and what to do.
    """
    aim, kind = objective_of(objective), motion_of(motion)
    if start.acceleration is None and end.acceleration is None:
        any_limit = Limits(speed=1.0)  # a tuning problem must have one, and its starting path is the same for all
        require_choices(start, end, any_limit, aim, kind, duration is not None)
        duration, turn = (None if x is None else as_float(x) for x in (duration, turn))
        # A callable objective may hold arrays, which are constants of the problem: it is not traced.
        posed = _posed_once if aim.is_smooth else pose
        problem = posed(start, end, aim, kind, duration, whole_turns(turns), placement, turn)
        require_sound(problem, turn, any_limit, None, placement is not None)
        path = _unmoved(problem.without_objective())
        return path if placement is not None else eqx.tree_at(lambda path: path.placement, path, None)
    if kind.is_uniform or duration is None:
        raise ValueError("boundary states with accelerations make a path only with motion='hermite' and a duration")
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    short = azimuth_difference(a, b)
    whole = round(float(directed_turn(a, b, turns) - short) / (2 * jnp.pi))
    return SpiralHelix.hermite(start, end, as_float(duration), whole, placement)


_posed_once = eqx.filter_jit(pose)


@eqx.filter_jit
def _unmoved(problem: Problem) -> SpiralHelix:
    return problem.path(jnp.zeros(problem.size, problem.speed.dtype))
