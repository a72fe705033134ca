"""Boundary velocities that meet limits: the path nearest to the given states, the fastest or the smoothest."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import SAMPLED
from qtraj.design.proof.certify import certify
from qtraj.design.tuning import augmented, campaign, relief
from qtraj.design.tuning.box import Bounds, at_the_wall, box, require_names, weights_of
from qtraj.design.tuning.campaign import Found, Tell, take
from qtraj.design.tuning.checks import require_choices, require_sound
from qtraj.design.tuning.outcome import CONVERGED, INFEASIBLE, NOT_CONVERGED, Tuned
from qtraj.design.tuning.problem import Objective, Problem, pose
from qtraj.design.tuning.sensitivity import solution
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task
from qtraj.foundation.arrays import as_float
from qtraj.foundation.exported.kept import kept
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState, Cylindrical
from qtraj.path.boundary_problem import whole_turns
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

AIM = 1 - 4e-9
"""Tuning aims at this part of each limit, so that round-off at a peak does not break the limit that was given."""

LEAST_LIMIT = 1e-100
"""Limits are taken for no less: the square of a smaller one vanishes, and tells no way to go."""

METHODS = ("sqp", "lbfgs")


def tune(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: Objective = "nearest",
    motion: str = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: ArrayInput | None = None,
    *,
    fixed: Sequence[str] = (),
    bounds: Bounds | None = None,
    weights: Mapping[str, float] | None = None,
    starts: int = 8,
    method: str | None = None,
    max_steps: int = 300,
    progress: Callable[[str], None] | None = None,
) -> Tuned:
    """Tune the boundary velocities between two positions until `limits` hold on the whole path.

    `objective`: "nearest" (least change of the six cylindrical velocity components at the ends; for hermite motion
    also of the duration), "fastest" (the duration), "smoothest" (∫|r⃛|²dt at fixed duration), or a differentiable
    callable of a path. `motion`: "uniform" moves V_ρ, V_h at both ends and the one rate ω; "hermite" moves all six
    components and, unless the objective is "smoothest", the duration. `duration` [s]: T₀ of "hermite", and the held
    duration of "smoothest"; by default the turn over the rate of the given states, whose V_φ/ρ need not agree. The
    turn has the sense of V_φ at the start, a magnitude in (0, 2π), and `turns` whole turns besides; where it is known,
    `turn` [rad, signed] gives it instead.

    The variables have names: "start.V_rho", "start.V_phi", "start.V_h", the same of "end" [m/s, about the axis], and
    "duration" [s]; uniform motion has no V_phi, which follows from the duration. `fixed` names those that keep their
    given value; `bounds` maps names to (lowest, highest), either of which may be None; `weights` multiplies the squared
    changes that "nearest" sums.

    `starts` searches begin at the given states and about them, and the best is kept. `method` is "sqp" (sequential
    quadratic programming on polished peaks, with exact second derivatives) or "lbfgs" (augmented Lagrangian, optax);
    by default the first, and the second for a callable objective, which then need not be twice differentiable, from the
    given states alone. Where no path meets the limits, the one that breaks them least is given, with advice. What is
    being done is told to `progress`, in a few words.

    **Batches**: states with lanes in front (`jax.vmap(BoundaryState)(positions, velocities)`), and limits, duration,
    turn and placement with the same lanes or shared, give an outcome with lanes, one compiled search for all.
    **Traces**: under `jit`, `vmap` and `grad` the same "sqp" runs on whole arrays, and the derivatives of its path in
    the boundary data and the limits are exact (implicit function theorem); infeasible problems are not looked into. A
    callable objective needs method="sqp" there.

    **Raises:** ValueError for input that makes no problem, or in float32. A problem without a solution is no error:
    its `status` is "infeasible" and its `result` says why and what would help.
    """
    require_choices(start, end, limits, objective, motion, duration is not None)
    method = _method(method, objective)
    bounds = dict(bounds or {})
    require_names(motion, objective == "smoothest", fixed, bounds)
    if starts < 1 or max_steps < 1:
        raise ValueError(f"starts and max_steps must be 1 or more, but {starts} and {max_steps} were given")
    weighed = weights_of(weights or {}, objective, motion)
    duration, turn = (None if x is None else as_float(x) for x in (duration, turn))

    start, end, lanes = _stacked(start, end)
    data = (start, end, limits, duration, turn, placement, _as_floats(bounds))
    # A callable objective may hold arrays, which are constants of the problem: it is not traced.
    posed = _posed_once if isinstance(objective, str) else _posed
    tasks = posed(data, _axes(data, lanes), objective, motion, whole_turns(turns), tuple(fixed), weighed)
    require_sound(tasks.problem, turn, limits)
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tasks)):
        if method == "lbfgs":
            raise ValueError("the search 'lbfgs' cannot be traced: pass method='sqp' under jit, vmap and grad")
        return _outcome(tasks, limits, _traced(tasks, starts, max_steps, lanes), start, end)
    stacked = tasks if lanes else take(tasks, None)
    search = _by_lbfgs if method == "lbfgs" else partial(campaign.best_of_each, starts=starts)
    found = search(stacked, most_steps=max_steps, tell=progress)
    if lanes:
        return _outcome(tasks, limits, found, start, end)
    outcome = _outcome(tasks, limits, take(found, 0), start, end)
    advice = at_the_wall(tasks.problem.names, np.asarray(found.z[0]), bounds)
    if int(outcome.code) == INFEASIBLE:
        advice = " ".join(filter(None, [relief.advice(stacked, found, max_steps, progress), advice]))
    return dataclasses.replace(outcome, advice=advice)


def _posed(
    data: tuple[Any, ...],
    axes: tuple[Any, ...],
    objective: Objective,
    motion: str,
    turns: int,
    fixed: tuple[str, ...],
    weights: Float[Array, " 7"],
) -> Task:
    """The task, or one of each lane."""

    def one(start: Any, end: Any, limits: Any, duration: Any, turn: Any, placement: Any, bounds: Any) -> Task:
        problem = pose(start, end, objective, motion, duration, turns, placement, turn, weights)
        aims = jax.tree.map(lambda x: jnp.maximum(AIM * x.astype(problem.speed.dtype), LEAST_LIMIT), limits)
        low, high = box(problem, fixed, bounds)
        return Task(problem, aims, low, high, jnp.ones_like(problem.speed))

    batched = any(axis is not None for axis in jax.tree.leaves(axes, is_leaf=lambda x: x is None))
    return eqx.filter_vmap(one, in_axes=axes)(*data) if batched else one(*data)


_posed_once = kept(Task, Problem, Cylindrical, Placement, Limits)(_posed)


def _stacked(start: BoundaryState, end: BoundaryState) -> tuple[BoundaryState, BoundaryState, tuple[int, ...]]:
    """Both states with the lanes of either, and these lanes.

    **Raises:** ValueError in lower precision than float64, and for lanes that are none or do not agree.
    """
    for state in (start, end):
        if state.position.dtype != jnp.float64:
            raise ValueError(
                f"tuning needs float64, but these states are in {state.position.dtype}. Call "
                "jax.config.update('jax_enable_x64', True) before building them."
            )
    shapes = {state.position.shape[:-1] for state in (start, end)} - {()}
    if len(shapes) > 1 or any(len(shape) != 1 or shape[0] == 0 for shape in shapes):
        raise ValueError(
            f"the states must have one axis of lanes, the same for both or none: shapes {start.position.shape} and "
            f"{end.position.shape} were given"
        )
    lanes: tuple[int, ...] = shapes.pop() if shapes else ()
    both = jax.tree.map(lambda x: jnp.broadcast_to(x, (*lanes, 3)), (start, end))
    return *both, lanes


def _method(method: str | None, objective: Objective) -> str:
    if method is None:
        return "sqp" if isinstance(objective, str) else "lbfgs"
    if method not in METHODS:
        raise ValueError(f"method must be {' or '.join(map(repr, METHODS))}, but {method!r} was given")
    return method


def _as_floats(bounds: Bounds) -> Any:
    return {name: tuple(None if x is None else as_float(x) for x in pair) for name, pair in bounds.items()}


def _axes(data: tuple[Any, ...], lanes: tuple[int, ...]) -> tuple[Any, ...]:
    """Where each array of the data has its lanes: in front, or nowhere if it is shared.

    **Raises:** ValueError for lanes of another number.
    """
    vectors = (True, True, False, False, False, True, False)  # states and placements are vectors, the rest numbers

    def axis(x: Any, plain: int) -> int | None:
        if x.ndim == plain:
            return None
        if x.shape[: x.ndim - plain] != lanes:
            raise ValueError(
                f"the states have the lanes {lanes}, but other data have the shape {x.shape}: stack the states likewise"
            )
        return 0

    return tuple(
        jax.tree.map(lambda x, plain=int(vector): axis(x, plain), part)
        for part, vector in zip(data, vectors, strict=True)
    )


def _traced(tasks: Task, starts: int, most_steps: int, lanes: tuple[int, ...]) -> Found:
    """The search inside a trace, which only the solution's own derivatives pass."""

    def search(task: Task) -> Found:
        return campaign.best_of(task, starts, most_steps)

    fixed = jax.lax.stop_gradient(tasks)
    return jax.vmap(search)(fixed) if lanes else search(fixed)


def _by_lbfgs(tasks: Task, most_steps: int, tell: Tell | None) -> Found:
    """The searches of optax, lane after lane; the least excess where they end outside the limits."""
    return jax.tree.map(
        lambda *leaves: np.stack(leaves),
        *(_one_by_lbfgs(take(tasks, slice(k, k + 1)), most_steps, tell) for k in range(tasks.low.shape[0])),
    )


def _one_by_lbfgs(tasks: Task, most_steps: int, tell: Tell | None) -> Found:
    task = take(tasks, 0)
    given = jnp.clip(jnp.zeros_like(task.low), task.low, task.high)
    found = augmented.search(task, given, most_steps, tell)
    if float(found.excess) <= FEASIBLE:
        return found
    least = take(campaign.least_excess(tasks, jax.tree.map(lambda x: x[None], found), most_steps, tell), 0)
    if float(least.excess) > FEASIBLE:
        return least
    again = augmented.search(task, least.z, most_steps, tell)
    return again if float(again.excess) <= FEASIBLE else least._replace(settled=jnp.asarray(False))


def _outcome(tasks: Task, limits: Limits, found: Found, start: BoundaryState, end: BoundaryState) -> Tuned:
    path, objective, states = _reached(tasks, found, start, end)
    certificate = certify(path, limits)
    return Tuned(path, *states, objective, certificate, _code(found, certificate.codes), found.steps)


@kept()
def _code(found: Found, codes: Int[Array, "*lanes n"]) -> Int[Array, "*lanes"]:
    """How a tuning ended, whose path has findings of these codes."""
    met = jnp.all(codes <= SAMPLED, axis=-1)
    code = jnp.where(found.settled & met & (found.excess <= FEASIBLE), CONVERGED, NOT_CONVERGED)
    return jnp.where((found.excess > FEASIBLE) & ~met, INFEASIBLE, code).astype(jnp.int32)


@kept(SpiralHelix, Placement, BoundaryState)
def _reached(
    tasks: Task, found: Found, start: BoundaryState, end: BoundaryState
) -> tuple[SpiralHelix, Array, tuple[BoundaryState, BoundaryState]]:
    """The paths of the solutions, the objectives there, and their boundary states."""

    def one(task: Task, found: Found, start: BoundaryState, end: BoundaryState) -> tuple[Any, ...]:
        z = solution(task, jax.lax.stop_gradient(found))
        path = task.problem.path(z)
        first = BoundaryState(start.position, path.velocity(0.0))
        return path, task.problem.attained(z), (first, BoundaryState(end.position, path.velocity(path.duration)))

    return (jax.vmap(one) if found.excess.ndim > 0 else one)(tasks, found, start, end)
