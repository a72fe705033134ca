"""Run searches from several starts, and select the best result.

If no result satisfies the limits, the result with the smallest violation is selected.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.tuning import rescaling
from qtraj.design.tuning.both_sides import starts_around
from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.model import build
from qtraj.design.tuning.motions.motion import COMPONENTS
from qtraj.design.tuning.peaks import find_peaks
from qtraj.design.tuning.problem import DURATION
from qtraj.design.tuning.screened import screened_starts
from qtraj.design.tuning.search import TIE, AbstractSearch, Ends, Penalty, SearchResult
from qtraj.design.tuning.searches import Curves, Searches
from qtraj.design.tuning.sqp import FEASIBLE, SequentialQuadratic
from qtraj.design.tuning.subproblem import compute_step
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

SLOW = ((0.0, 0.0, 1.5), (0.5, -0.5, 1.5), (0.5, -0.5, 2.5))
"""Further starts if no search from a planned start satisfies the limits: slow and almost straight paths."""

NEAR, SPREAD = 0.05, 0.6
"""Standard deviations of the planned starts about their nominal values, and of all other starts about zero."""

SEED = 20171993
VIOLATION_STEPS = 6
"""Maximum number of steps that minimise a violation, relative to the maximum number of steps of a search."""

MULTIPLIER_RADIUS = 1e-2
"""Trust radius of the subproblem that determines the multipliers at a solution."""

REFINED = 4
"""Number of final points of each problem from which "sqp" continues after another method, starting with the best."""

INFEASIBLE_COST = 1e100
"""The minimum merit of a result that violates the limits, larger than any cost."""


def starting_points(names: Sequence[str], starts: int) -> np.ndarray:
    """Return the starts (starts, variables): the initial states, planned changes, and reproducible random changes."""
    planned = _changes(names, PLANNED)
    spread = np.where(np.arange(starts) < len(PLANNED), NEAR, SPREAD) * (np.arange(starts) > 0)
    points = spread[:, None] * np.random.default_rng(SEED).standard_normal((starts, len(names)))
    points[: len(planned)] += planned[:starts]
    return points


def _changes(names: Sequence[str], planned: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """Return planned changes of all variables (planned, variables)."""
    return np.asarray(
        [[dict(zip(PLANNED_VARIABLES, change, strict=True)).get(name, 0.0) for name in names] for change in planned]
    )


def solve(
    method: AbstractSearch,
    searches: Searches,
    starts: int,
    max_steps: int,
    report: Report | None = None,
    posed: Any = None,
) -> SearchResult:
    """Return the best result of each problem of a batch; an ill-posed one, False in `posed`, has none and is NaN.

    If no search from a planned start satisfies the limits of a problem, "sqp" minimises the violation from these starts
    and from slow paths, each in at most `VIOLATION_STEPS` times `max_steps` steps. If the limits are then satisfied,
    the objective is minimised from the resulting points. If this fails, the same is done from the best of many random
    paths, and if still no search satisfies the limits, from all other starts. So more starts, and first steps of an
    optimiser, never give a worse result than the planned starts alone.
    """
    count = searches.count
    if posed is not None and not posed.all():
        index = np.flatnonzero(posed) if posed.any() else np.arange(1)  # one gives the shapes
        some = solve(method, searches.take(index), starts, max_steps if posed.any() else 0, report)
        if not posed.any():
            some = some._replace(steps=np.zeros_like(some.steps), starts=np.zeros_like(some.starts))
        return some.among(index, count)
    points, planned = _points(searches, starts)
    starts = points.shape[2]
    ends = _search(method, searches.take(np.repeat(np.arange(count), starts)), _joined(points), report, "searches")
    if method.refined_by is not None:
        method = method.refined_by
        ends = _refined(method, searches, ends, points[:, :, :planned], report)
    chosen = _best(ends, count)
    best, result = ends.take(chosen), ends.take(chosen)
    first = ends.take(np.arange(ends.cost.size).reshape(count, -1)[:, :planned].ravel())
    first = first.take(_best(first, count))
    tried = np.full(count, starts)

    def rescue(failed: np.ndarray, ends: Ends, points: np.ndarray) -> np.ndarray:
        """Search again from `ends` and `points`, and return the problems that are still without a solution."""
        found = _rescued(method, searches.take(failed), ends.take(failed), points, max_steps, report)
        better = _merit(found) < _merit(result.take(failed))
        result.put(failed[better], found.take(better))
        return failed[~((found.largest <= FEASIBLE) & found.stationary)]

    failed = np.flatnonzero(~(first.largest <= FEASIBLE))
    if failed.size:
        slow = np.repeat(_changes(searches.problem.names, SLOW).T[:, None], failed.size, axis=1)
        tried[failed] += len(SLOW)
        failed = rescue(failed, first, np.concatenate([points[:, failed, :planned], slow], axis=2))
    if failed.size and searches.limits:
        screened = screened_starts(searches.take(failed))
        tried[failed] += screened.shape[2]
        rescue(failed, first, screened)
    failed = np.flatnonzero(~(result.largest <= FEASIBLE))
    if failed.size and starts > planned:
        rescue(failed, best, points[:, failed, planned:])
    return with_active(searches, result, tried)


def _points(searches: Searches, starts: int) -> tuple[Float[np.ndarray, "n batch starts"], int]:
    """Return the starts of each problem, and the number of planned ones, which are first: also those at obstacles."""
    around = starts_around(searches)
    usual = np.repeat(starting_points(searches.problem.names, starts).T[:, :, None], searches.count, axis=2)
    parts = usual[:, : len(PLANNED)], around, usual[:, len(PLANNED) :]
    return np.concatenate(parts, axis=1).swapaxes(1, 2), parts[0].shape[1] + around.shape[1]


def _joined(points: Float[np.ndarray, "n batch starts"]) -> Float[np.ndarray, "n searches"]:
    """Return the starts of all problems along one axis."""
    return points.reshape(len(points), -1)


def minimise_violation(searches: Searches, z: np.ndarray, max_steps: int, report: Report | None = None) -> Ends:
    """Minimise the largest constraint value in each problem of a batch, from the given points."""
    problem = searches.problem
    if not problem.objective.is_formula:
        problem = problem.without_objective()
    alone = dataclasses.replace(searches, problem=problem, weight=np.zeros_like(searches.weight))
    return _search(SequentialQuadratic(max_steps), alone, z, report, "least violations")


def with_active(searches: Searches, ends: Ends, starts: Int[np.ndarray, " batch"]) -> SearchResult:
    """Return the results of searches with their active peaks, which a subproblem at each solution determines.

    `starts` are the numbers of starts from which the results were found.
    """
    z, largest = ends.z, np.maximum(ends.largest, 0.0)
    with np.errstate(all="ignore"):
        unmet = largest > FEASIBLE
        own = dataclasses.replace(searches, weight=np.where(unmet, 0.0, 1.0))
        if not own.problem.objective.is_formula and unmet.all():
            own = dataclasses.replace(own, problem=own.problem.without_objective())
        if not own.problem.objective.is_formula:
            own = rescaling.measured(own, z)
        model = build(own, z, find_peaks(own, Curves(own, z))[0])
        penalty, multipliers = np.where(unmet, 1.0, 1e4), np.zeros(model.value.shape)
        for _ in range(2):  # the Hessian of the second subproblem contains the multipliers of the first
            radius, size = np.full(own.count, MULTIPLIER_RADIUS), np.zeros(own.count)
            multipliers = compute_step(own, z, model, multipliers, penalty, radius, size, size == 0).multipliers
        multipliers = np.where(model.value > ABSENT, multipliers, 0.0)
    rows = len(z) + 1
    order = np.argsort(-multipliers, axis=0, kind="stable")[:rows]
    parts = (np.take_along_axis(x, order, axis=0) for x in (model.limit, model.time, multipliers))
    missing = [(0, rows - len(order)), (0, 0)]
    limit, time, multiplier = (np.pad(x, missing).T for x in parts)
    scale = own.problem.scale
    return SearchResult(
        z.T, np.maximum(limit, 0), time, multiplier, largest, ends.stationary, ends.steps, scale, starts
    )


def _rescued(
    method: AbstractSearch,
    searches: Searches,
    ends: Ends,
    points: np.ndarray,
    max_steps: int,
    report: Report | None,
) -> Ends:
    """Minimise the violation from one final point of each problem, and from other points (n, batch, points).

    Where the limits are then satisfied, minimise the objective from the resulting points. Return the best results.
    """
    count = searches.count
    z = np.concatenate([ends.z[:, :, None], points], axis=2)
    each = z.shape[2]
    many = searches.take(np.repeat(np.arange(count), each))
    found = minimise_violation(many, _joined(z), VIOLATION_STEPS * max_steps, report)
    # A path that satisfies the limits, but was not optimised for the objective, is not a solution.
    feasible = found.largest <= FEASIBLE
    found = found._replace(stationary=found.stationary & ~feasible)
    if not searches.problem.objective.is_formula:
        found = found._replace(cost=rescaling.values(many.problem, found.z))
    index = np.flatnonzero(feasible)
    if index.size:
        met = _continued(method, many, found, index, report, Penalty.LARGE)
        none = np.isin(index // each, index[met] // each, invert=True)  # problems without a result
        if none.any():
            _continued(method, many, found, index[none], report, Penalty.FIXED)
    best = found.take(_best(found, count))
    return best._replace(steps=ends.steps + best.steps)


def _continued(
    method: AbstractSearch, many: Searches, found: Ends, index: np.ndarray, report: Report | None, penalty: Penalty
) -> np.ndarray:
    """Minimise the objective from feasible paths; replace those from which the search ends at another feasible path.

    Return which ones are replaced.
    """
    final = _search(method, many.take(index), found.z[:, index], report, "searches", penalty)
    final = final._replace(steps=found.steps[index] + final.steps)
    met = final.largest <= FEASIBLE
    found.put(index[met], final.take(met))
    return met


def _refined(
    method: AbstractSearch, searches: Searches, ends: Ends, planned: np.ndarray, report: Report | None
) -> Ends:
    """Search from the planned starts of each problem (n, batch, starts), and continue from its best final points."""
    count, starts = searches.count, ends.cost.size // searches.count
    order = np.argsort(_merit(ends).reshape(count, starts), axis=1, kind="stable")[:, :REFINED]
    chosen = np.arange(count)[:, None] * starts + order
    z = np.concatenate([planned, ends.z[:, chosen]], axis=2)
    each = np.repeat(np.arange(count), z.shape[2])
    refined = _search(method, searches.take(each), _joined(z), report, "best results")
    return refined._replace(steps=refined.steps + ends.steps[::starts][each])


def _best(ends: Ends, count: int) -> np.ndarray:
    """Return the index of the best result of each of `count` problems, which have equally many searches."""
    merit = _merit(ends).reshape(count, -1)
    return np.arange(count) * merit.shape[1] + np.argmin(merit, axis=1)


def _merit(ends: Ends) -> np.ndarray:
    """Return the numbers by which results are compared: the cost, or a large number that grows with the violation."""
    cost = np.asarray(ends.cost, float)
    cost = np.where(ends.stationary, cost, cost + TIE * ends.unit)
    met = (ends.largest <= FEASIBLE) & np.isfinite(cost)
    violation = np.nan_to_num(np.asarray(ends.largest, float), nan=1e3)
    return np.where(met, cost, INFEASIBLE_COST * (1 + np.clip(violation, 0.0, 1e3)))


def _search(
    method: AbstractSearch,
    searches: Searches,
    z: np.ndarray,
    report: Report | None,
    what: str,
    penalty: Penalty = Penalty.USUAL,
) -> Ends:
    """Run searches, and report their progress."""

    def callback(done: int) -> None:
        if report is not None:
            report(Progress(what, done, searches.count))

    if searches.problem.objective.is_formula:
        return method.search(searches, z, callback, penalty)
    return rescaling.run(
        lambda few, points: method.search(few, points, callback, penalty), searches, z, method.total_steps
    )
