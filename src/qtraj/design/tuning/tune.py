"""Tune boundary velocities so that a path satisfies limits and minimises an objective."""

from __future__ import annotations  # so that `help` shows short names

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from qtraj.design.limits import Limits
from qtraj.design.obstacles.keep_out import checked as checked_obstacles
from qtraj.design.tuning import multistart, traced
from qtraj.design.tuning.advisor import Advisor
from qtraj.design.tuning.assembly import make_outcome
from qtraj.design.tuning.box import Bounds, box, change_weights, require_names
from qtraj.design.tuning.checks import fault_codes, require_choices, require_well_posed
from qtraj.design.tuning.clearances import Clearances, clearances_of
from qtraj.design.tuning.methods import Method, get_method
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.motions.registry import get_motion
from qtraj.design.tuning.objectives.custom import Custom
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.objectives.registry import Objective, get_objective
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.problem import broadcasting, pose
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.searches import Searches, searches_of
from qtraj.design.tuning.targets import search_limits
from qtraj.design.tuning.task import Task, one
from qtraj.design.tuning.zoned import require_supported, solve_in_zones
from qtraj.foundation.arrays import as_float, constants, is_traced, like
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.namespace import in_float64
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress import Report
from qtraj.foundation.reporting import reporting
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.placement import Placement
from qtraj.path.road_parameters import RoadParameters


@of_one_device
def tune(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: Objective = "nearest",
    motion: str | AbstractMotion = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: ArrayInput | None = None,
    *,
    fixed: Sequence[str] = (),
    bounds: Bounds | None = None,
    weights: Mapping[str, float] | None = None,
    nearest_to: AbstractHodograph | None = None,
    corridor: ArrayInput | None = None,
    starts: int = 8,
    method: Method = "sqp",
    max_steps: int = 300,
    inner_steps: int = 600,
    progress: Report | bool | None = None,
    throw: bool = False,
) -> Tuned:
    """Tune the boundary velocities between two positions so that the path satisfies `limits` everywhere.

    `objective` is "nearest" (the weighted sum of squared changes of the six cylindrical velocity components at the ends
    and, for "hermite" motion, of the duration), "fastest" (the duration), "smoothest" (∫|r⃛|²dt at fixed duration), or
    a differentiable function of a path. `motion` "uniform" varies V_ρ and V_h at both ends and the angular rate ω;
    "hermite" varies all six components and the duration. The objective "smoothest" fixes ω and the duration. `duration`
    [s] is the initial duration of "hermite", and the fixed duration of "smoothest". The default duration is the turn
    divided by an average of the angular rates of the initial states. The path turns about the z axis of `placement`, by
    default the world's z axis. If the states are far from this axis, pass a placement such as `axis_between(start,
    end)`. The path turns in the sense of V_φ at the start, by an angle in (0, 2π) plus `turns` whole turns, or by the
    signed angle `turn` [rad].

    The variables have the names "start.V_rho", "start.V_phi", "start.V_h", "end.V_rho", "end.V_phi", "end.V_h" [m/s]
    and "duration" [s]. In uniform motion V_phi is not a variable, because the duration determines it. `fixed` names the
    variables that keep their initial value. `fixed` also accepts "start.heading" and "end.heading", which fix the
    direction of the horizontal velocity but not its magnitude, so that a vehicle may drive the same street more slowly.
    `bounds` maps names to (lower, upper) in the units above, where None means the default bound. `weights` maps names
    to weights of the squared changes in "nearest".

    `nearest_to` is a path of any kind, which replaces the initial states in the objective "nearest". The objective then
    is the mean squared distance [m²] between the points at equal fractions of the arc lengths of both paths. It depends
    on the shape of `nearest_to` and on its direction, but not on its timing. If no limit determines the timing of the
    result either, fix the duration: many paths are then equally near, and derivatives of the solution do not exist.

    Limits may change along the way (`Along`, with the method "sqp"): they hold between distances along the path that is
    being tuned. `Regions` become limits along the initial path; if the tuned path violates them, they become limits
    along this path, and the path is tuned again. Limits that depend on the speed (`BySpeed`, `Ellipse`) need "sqp",
    too, and must allow zero at every speed.

    Obstacles in `limits.keep_out` are avoided by the whole `body`. Further searches start on both sides of the three
    obstacles nearest to the initial path: outside and inside, above and below. Obstacles may move; all problems of a
    batch have the same ones.

    `corridor` [m] limits the distance from the initial path at equal fractions of the two durations, with the
    difference of the azimuths measured along the arc (an upper bound on the straight-line distance). The corridor is an
    additional limit, the last one in the certificate.

    `tune` runs `starts` searches from the initial states and perturbations of them, and returns the best result. If
    none satisfies the limits, searches for the smallest violation run from all these starts and from slow paths, and
    then from the best of many random paths. If these fail, too, the result is the path with the smallest violation,
    with advice. `starts_tried` is the number of starts. `progress` is called with a `Progress` a few times per second;
    `progress=True` displays the progress (extra `cli`).

    `method` "sqp" is sequential quadratic programming on refined peaks with exact second derivatives. With an
    `optax.GradientTransformation` such as `optax.adam(1e-2)`, or with "lbfgs" or "adam" (learning rate 1e-2), all
    searches of a batch first take `inner_steps` steps of the optimiser together, on an accelerator if there is one.
    "sqp" then continues from the four best results of each problem, and from the first eight starts, too. This is worth
    its compilation for large batches with many starts. `max_steps` is the maximum number of steps of "sqp"; if
    limits remain violated, the search for the smallest violation has at most six times as many. A search that they end
    is "not converged", with `converged` false. Reuse the same optimiser object to avoid recompilation.

    A callable objective must be a pure function. Its value may have any unit: the search takes the scale from the first
    and second derivatives, so a constant or a factor in the objective changes neither the path nor the status, up to
    the rounding error of the value. Each new function and its derivatives are compiled, and any value that the function
    reads from its scope is constant from then on. If the function is a pytree, such as a
    `jax.tree_util.Partial` or an `equinox.Module`, its arrays are arguments of the compiled code, so new values need
    no recompilation. Each search of a batch stores its own copy of these arrays.

    **Batches**: for states with a batch dimension (`jax.vmap(BoundaryState)(positions, velocities)`) the outcome has
    the same batch dimension. Limits, duration, turn and placement are shared or have the same dimension. An ill-posed
    element has the status "ill-posed", a path of NaN, and the reason in `result`.

    **Transformations**: the function can be used under `jit`, `vmap` and `grad`. For any method, the derivatives of the
    path with respect to the boundary data, the limits and the arrays in a callable objective are the derivatives of the
    solution (implicit function theorem), also of higher order; they have no meaning if the search did not converge.
    Outside `jit` and `vmap`, `grad` runs the same search as a call without derivatives. Under all of these
    transformations, infeasible problems get no advice.

    **Precision**: float32 states are converted, the search and the proof use float64, and the path is in float64.

    **Raises:** ValueError for contradictory arguments, for a single ill-posed problem, for float32 inside `jit`, `grad`
    or `vmap`, or for traced obstacles. A problem without a solution is not an error: its `status` is "infeasible", and
    its `result` contains the reason and advice. With `throw`, RuntimeError if the status of any problem is not
    "converged".
    """
    start, end, limits, placement = in_float64((start, end, limits, placement))
    objective, motion = get_objective(objective, nearest_to), get_motion(motion)
    require_choices(start, end, limits, objective, motion, duration is not None)
    method = get_method(method, max_steps, inner_steps)
    bounds = dict(bounds or {})
    require_names(motion, objective, fixed, bounds)
    if starts < 1:
        raise ValueError(f"starts must be 1 or more, but {starts} was given")
    weight_array = change_weights(weights or {}, objective, motion)
    duration, turn, corridor = (None if x is None else as_float(x) for x in (seconds(duration), turn, corridor))

    start, end, batch = _as_batch(start, end)
    road = limits.road().each(as_float) if limits.uses_vehicle else None
    axis, bounds_of = Placement() if placement is None else placement, _as_floats(bounds)
    _require_batch((duration, turn, axis, bounds_of, road, limits.constant(), corridor), batch)
    limits.require_batch(batch, "the states")

    clearances = clearances_of(checked_obstacles(limits))
    data = (start, end, limits, duration, axis, turn, weight_array, road, corridor, bounds_of)
    choices: Any = {"motion": motion, "turns": turns, "fixed": tuple(fixed), "clearances": clearances}
    with np.errstate(all="ignore"), broadcasting():  # ill-posed problems are reported below
        # Outside jit, the derivatives of separate operations would be compiled one by one.
        compiled = objective.is_formula and is_traced(start, end, duration, axis, turn)
        tasks = (_compiled_tasks if compiled else _tasks)(objective, *data, **choices)
    if isinstance(objective, Custom) and is_traced(tasks, start, end, duration):
        explicit = objective.with_closure(one(constants(tasks.problem)))
        with broadcasting():
            tasks = tasks if explicit is objective else _tasks(explicit, *data, **choices)
    # Outside jit and vmap, the values of differentiated arrays are known, so the search does not have to be traced.
    constant, *others = constants((tasks, turn, limits, corridor))
    checked: Any = (constant.problem if batch else one(constant.problem), *others, placement is not None)
    unknown = is_traced(constant, others)
    require_supported(limits, method, batch, is_traced(tasks, start, end, turn, limits, corridor))
    if not (batch or unknown):
        require_well_posed(*checked)
    with np.errstate(all="ignore"), broadcasting():
        faults = fault_codes(*checked)
    posed = faults == ResultCode.successful
    if unknown:
        result = traced.solve(method, constant, posed, starts, max_steps)
        outcome = make_outcome(tasks, limits, corridor, result, start, end, batch, placement, faults)
        return outcome.check() if throw else outcome
    with reporting(progress) as report:
        searches = searches_of(constant.problem, constant.limits, constant.low, constant.high)

        def solved(searches: Searches) -> tuple[SearchResult, Tuned]:
            result = multistart.solve(method, searches, starts, max_steps, report, posed)
            return result, make_outcome(tasks, limits, corridor, result, start, end, batch, placement, faults)

        searches, result, outcome = (
            solve_in_zones(searches, limits, corridor, solved) if limits.varying else (searches, *solved(searches))
        )
        if is_traced(tasks, turn, limits, corridor):
            return outcome.check() if throw else outcome
        advisor = Advisor(searches, result, starts, max_steps, bounds, limits.vehicle)
        if batch:
            place = np.stack([np.full(batch, advisor.number), np.arange(batch[0])], axis=1)
            outcome = dataclasses.replace(outcome, advisor=advisor, place=place)
        else:
            outcome = dataclasses.replace(outcome, advice=advisor(0, ResultCode(int(outcome.code)), report))
    return outcome.check() if throw else outcome


def _tasks(
    objective: AbstractObjective,
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    duration: Any,
    axis: Placement,
    turn: Any,
    weights: Any,
    road: RoadParameters | None,
    corridor: Any,
    bounds: Any,
    *,
    motion: AbstractMotion,
    turns: int,
    fixed: tuple[str, ...],
    clearances: Clearances | None,
) -> Task:
    """Return the problems of a batch of states with their limits and bounds."""
    problem = pose(start, end, objective, motion, duration, turns, axis, turn, weights, fixed, road, clearances)
    names = () if clearances is None else clearances.by_name
    return Task(problem, search_limits(limits, corridor, len(start.position), names), *box(problem, fixed, bounds))


_compiled_tasks = eqx.filter_jit(_tasks)


def _as_batch(start: BoundaryState, end: BoundaryState) -> tuple[BoundaryState, BoundaryState, tuple[int, ...]]:
    """Return both states with a batch dimension, and the user's batch shape, which is () for one problem.

    **Raises:** ValueError for traced float32, or if batches are empty or have different sizes.
    """
    for state in (start, end):
        if state.position.dtype != jnp.float64:
            raise ValueError(
                f"inside jit, grad and vmap, tuning needs float64, but these states are in {state.position.dtype}. "
                "Call jax.config.update('jax_enable_x64', True) before creating them."
            )
    shapes = {state.position.shape[:-1] for state in (start, end)} - {()}
    if len(shapes) > 1 or any(len(shape) != 1 or shape[0] == 0 for shape in shapes):
        raise ValueError(
            "start and end must have the same nonempty batch shape (n,), or no batch dimension, but positions of the "
            f"shapes {start.position.shape} and {end.position.shape} were given"
        )
    batch: tuple[int, ...] = shapes.pop() if shapes else ()
    count = batch[0] if batch else 1

    def expanded(x: Any) -> Any:
        if isinstance(x, Tracer):
            return jnp.broadcast_to(x, (count, 3))
        return like(np.broadcast_to(np.asarray(x), (count, 3)), x)

    both = jax.tree.map(expanded, (start, end))
    return *both, batch


def _as_floats(bounds: Bounds) -> Any:
    return {name: tuple(None if x is None else as_float(x) for x in pair) for name, pair in bounds.items()}


def _require_batch(shared: tuple[Any, ...], batch: tuple[int, ...]) -> None:
    """Raise a ValueError if the batch shape of any data differs from the batch shape of the states."""
    for each in shared:
        core_ndim = int(isinstance(each, Placement))
        for x in jax.tree.leaves(each):
            if x.ndim != core_ndim and x.shape[: x.ndim - core_ndim] != batch:
                raise ValueError(
                    f"the states have the batch shape {batch}, but another argument, such as a limit or "
                    f"a bound, has the shape {x.shape}: pass all data with the same batch shape or without a batch "
                    "dimension"
                )
