"""Run searches from several starts, and select the best result.

If no result satisfies the limits, the result with the smallest violation is selected.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.design.tuning import batch
from qtraj.design.tuning.motions.motion import COMPONENTS
from qtraj.design.tuning.peaks import ABSENT
from qtraj.design.tuning.problem import DURATION
from qtraj.design.tuning.search import AbstractSearch, SearchResult
from qtraj.design.tuning.sqp import FEASIBLE, SequentialQuadratic
from qtraj.design.tuning.task import LimitSlots, Task
from qtraj.foundation.arrays import part
from qtraj.foundation.progress import Progress, Report

PLANNED_VARIABLES: tuple[str, ...] = (f"start.{COMPONENTS[0]}", f"end.{COMPONENTS[0]}", DURATION)
PLANNED = (
    (0.0, 0.0, 0.0),
    (-1.0, 1.0, -0.5),
    (1.0, -1.0, 0.0),
    (-0.5, 0.5, 0.0),
    (0.5, -0.5, -0.5),
    (0.0, 0.0, -0.7),
    (1.0, 1.0, 0.0),
    (-1.0, -1.0, 0.0),
)
"""The planned starts: changes of V_ρ at both ends, in units of the reference speed, and of ln(duration).

The local optima of a problem differ in the instant at which the path swings outwards. Searches from the first five
starts reach the best known optimum in 998 of 1000 random problems. With eight random starts, the number is 992, and
with the initial states alone, it is 964.
"""

NEAR, SPREAD = 0.05, 0.6
"""Standard deviations of the planned starts about their nominal values, and of all other starts about zero."""

SEED = 20171993
MAX_LOWERINGS, LOWERING = 6, 0.5
"""Maximum number of times that limits are lowered to minimise a violation, and the ratio of lowered limits to peaks."""

INFEASIBLE_COST = 1e100
"""The minimum merit of a result that violates the limits, larger than any cost."""


def starting_points(names: Sequence[str], starts: int) -> np.ndarray:
    """Return the starts (starts, variables): the initial states, planned changes, and reproducible random changes."""
    planned = np.asarray(
        [[dict(zip(PLANNED_VARIABLES, change, strict=True)).get(name, 0.0) for name in names] for change in PLANNED]
    )
    spread = np.where(np.arange(starts) < len(PLANNED), NEAR, SPREAD) * (np.arange(starts) > 0)
    points = spread[:, None] * np.random.default_rng(SEED).standard_normal((starts, len(names)))
    points[: len(planned)] += planned[:starts]
    return points


def solve_traced(method: AbstractSearch, tasks: Task, slots: LimitSlots, starts: int) -> SearchResult:
    """Return the best result of each problem of a batch; the arguments can be traced."""
    count = tasks.low.shape[0]
    points = jnp.asarray(np.tile(starting_points(tasks.problem.names, starts), (count, 1)), tasks.low.dtype)
    many = jax.tree.map(lambda x: jnp.repeat(x, starts, axis=0), tasks)
    states = method.run(many, slots, method.init(many, points), method.step_limit)
    result, merit = _results_and_merit(method, many, states, jnp)
    best = jnp.arange(count) * starts + jnp.argmin(merit.reshape(count, starts), axis=1)
    return jax.tree.map(lambda x: x[best], result)


def solve(
    method: AbstractSearch, tasks: Task, slots: LimitSlots, starts: int, max_steps: int, report: Report | None = None
) -> SearchResult:
    """Return the best result of each problem of a batch, computed on all cores.

    If no search satisfies the limits of a problem, "sqp" minimises the violation from the best result in at most
    `max_steps` steps. If the limits are then satisfied, the objective is minimised from this point.
    """
    n_problems = tasks.low.shape[0]
    points = np.tile(starting_points(tasks.problem.names, starts), (n_problems, 1))
    many = _repeat(tasks, starts)
    states = batch.search(method, many, slots, points, _progress_callback(report, "searches"))
    result, merit = _results_and_merit(method, many, states, np)
    best = np.arange(n_problems) * starts + np.argmin(merit.reshape(n_problems, starts), axis=1)
    result = _select(result, best)
    infeasible = np.flatnonzero(result.violation > FEASIBLE)
    if infeasible.size == 0:
        return result
    rescued = _rescue(method, take(tasks, infeasible), slots, _select(result, infeasible), max_steps, report)
    return _replace(result, infeasible, rescued)


def minimise_violation(
    tasks: Task, slots: LimitSlots, result: SearchResult, max_steps: int, report: Report | None = None
) -> SearchResult:
    """Minimise the largest violation in each problem of a batch, starting from the results of other searches."""
    method = SequentialQuadratic(max_steps)
    tasks, result = without_objective(tasks), jax.tree.map(np.asarray, result)
    for _ in range(MAX_LOWERINGS):
        ratio = LOWERING * np.sqrt(1 + 2 * result.violation)
        lowered = eqx.tree_at(
            lambda t: (t.limits, t.weight),
            tasks,
            (np.asarray(tasks.limits) * ratio[:, None], np.zeros_like(tasks.weight)),
        )
        states = batch.search(method, lowered, slots, result.z, _progress_callback(report, "least violations"))
        lowered_result, _ = method.result(lowered, states, np)
        squares = (ratio**2)[:, None, None] * (1 + 2 * lowered_result.values)  # relative to the original limits
        ratio_left = ratio * np.sqrt(1 + 2 * lowered_result.violation)
        result = lowered_result._replace(
            violation=np.maximum(0.5 * (ratio_left**2 - 1), 0.0),
            values=np.where(lowered_result.values > ABSENT, 0.5 * (squares - 1), lowered_result.values),
            steps=result.steps + lowered_result.steps,
        )
        # If a path satisfies the lowered limits, its violation is not yet minimal: lower the limits again.
        if not np.any((lowered_result.violation <= FEASIBLE) & (result.violation > FEASIBLE)):
            break
    return result


def take(tree: Any, place: Any) -> Any:
    """Select elements of a batch in every array of `tree`."""
    return jax.tree.map(lambda x: part(x, place) if eqx.is_array(x) else x, tree)


def _select(result: SearchResult, indices: np.ndarray) -> SearchResult:
    return jax.tree.map(lambda x: x[indices], result)


def _replace(result: SearchResult, indices: np.ndarray, by: SearchResult) -> SearchResult:
    """Replace the elements at `indices` of a result by the elements of the result `by`."""

    def replaced(old: np.ndarray, new: np.ndarray) -> np.ndarray:
        updated = np.array(old)
        updated[indices] = new
        return updated

    return jax.tree.map(replaced, result, by)


def without_objective(tasks: Task) -> Task:
    """Replace a custom objective, which may not be twice differentiable, by a smooth objective."""
    if tasks.problem.objective.is_smooth:
        return tasks
    return dataclasses.replace(tasks, problem=tasks.problem.without_objective())


def _rescue(
    method: AbstractSearch, tasks: Task, slots: LimitSlots, result: SearchResult, max_steps: int, report: Report | None
) -> SearchResult:
    """Minimise the violation. In problems where it becomes zero, minimise the objective from the resulting point."""
    rescued = minimise_violation(tasks, slots, result, max_steps, report)
    feasible = np.flatnonzero(rescued.violation <= FEASIBLE)
    # A path that satisfies the limits, but was not optimised for the objective, is not a solution.
    rescued = rescued._replace(
        stationary=rescued.stationary & (rescued.violation > FEASIBLE), steps=result.steps + rescued.steps
    )
    if feasible.size == 0:
        return rescued
    feasible_tasks = take(tasks, feasible)
    states = batch.search(method, feasible_tasks, slots, rescued.z[feasible], _progress_callback(report, "searches"))
    final, _ = method.result(feasible_tasks, states, np)
    rescued.steps[feasible] += final.steps
    met = final.violation <= FEASIBLE
    return _replace(rescued, feasible[met], _select(final._replace(steps=rescued.steps[feasible]), np.asarray(met)))


def _results_and_merit(method: AbstractSearch, tasks: Task, states: Any, xp: Any) -> tuple[SearchResult, Any]:
    """Return the results of searches, and the merit by which they are compared.

    The merit is the cost, or a large number that increases with the violation. `xp` is the module of the states'
    arrays, NumPy or jax.numpy.
    """
    result, cost = method.result(tasks, states, xp)
    cost = xp.where(result.stationary, cost, cost + 1e-9 * xp.abs(cost))
    met = (result.violation <= FEASIBLE) & xp.isfinite(cost)
    return result, xp.where(met, cost, INFEASIBLE_COST * (1 + xp.minimum(result.violation, 1e100)))


def _repeat(tasks: Task, times: int) -> Task:
    return tasks if times == 1 else take(tasks, np.repeat(np.arange(tasks.low.shape[0]), times))


def _progress_callback(report: Report | None, what: str) -> batch.Callback | None:
    return None if report is None else lambda done, of: report(Progress(what, done, of))
