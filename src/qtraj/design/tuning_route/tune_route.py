"""Define `tune_route`, which changes a whole route so that it satisfies its limits within a tube."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from qtraj.design.limit_checks import require_known_road
from qtraj.design.limits import Limits, limits_of, require_limits
from qtraj.design.obstacles.keep_out import checked
from qtraj.design.proof.certificate import UNDEFINED
from qtraj.design.tuning_route import around, many_starts, rounds, target
from qtraj.design.tuning_route.arguments import limited, require_differentiable, require_route
from qtraj.design.tuning_route.curves import largest_of
from qtraj.design.tuning_route.posed import Posed
from qtraj.design.tuning_route.remedy import Change, remedy, unbounded_jumps
from qtraj.design.tuning_route.sensitivity import differentiable
from qtraj.design.tuning_route.setup import Parts
from qtraj.design.tuning_route.shapes import route_in_tube
from qtraj.design.tuning_route.solution import Solution
from qtraj.design.tuning_route.target import require_target
from qtraj.design.tuning_route.traced import structure
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.design.tuning_route.verdict import code_of, no_worse, rank, result_of
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.namespace import in_float64
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.shape import Shape

CONTINUOUS = 1e-9
"""Largest jump at a joint that counts as rounding error, relative to the states of the joints."""


@of_one_device
def tune_route(
    route: Route | Shape,
    limits: Limits,
    tube: ArrayInput | tuple[ArrayInput, ArrayInput] | None = None,
    objective: str | None = None,
    fixed: ArrayInput | None = None,
    *,
    closed: bool = False,
    nearest_to: AbstractHodograph | None = None,
    max_steps: int = 300,
    throw: bool = False,
    starts: int = 1,
    method: Any = "interior_point",
) -> TunedRoute:
    """Change a `route` so that it satisfies `limits` everywhere and stays within a tube around the original route.

    The positions of the joints (across the path), their velocities and accelerations, and the durations of the
    segments change together. `tube` [m] is the half-width, by default 0.5, or a pair (horizontal, vertical) of
    half-widths. Each is one number or an array with one number for each joint, interpolated linearly. Distances are
    measured at equal fractions of corresponding segments.

    `objective`, by default "nearest":

    - "nearest" [m²]: the mean over the original route of |δr|² + s²|δr'|² + s⁴|δr''|² + s²(v δh/h)². Here δ is the
      change at equal fractions of a segment, derivatives are with respect to the original time, s is the mean duration
      of the segments that change, v is the original speed, and δh is the change of the duration h of the segment;
    - "smoothest" [m²/s⁵]: ∫|r⃛|²dt; the duration of the route, or of each part between stops, does not change;
    - "fastest" [s]: the duration; at least one limit must bound the speed. Because many routes are almost as fast, the
      search adds a term with the squared jerk; this term is about 0.1 % of the duration.

    `nearest_to` is a path of any kind, which replaces the original route in the objective "nearest": δr is then the
    difference from the point of this path at the same fraction of the arc length as on the original route, and its
    derivatives are those of a motion along this path at the pace of the route. The objective does not depend on the
    timing of `nearest_to`. The tube is still around the original route.

    `fixed`: a bool array, true where the state of a joint does not change; (n,), or (n, 3) for position, velocity and
    acceleration separately. By default the states at both ends are fixed, so that a tuned `window` joins the rest of
    the route without a jump in position, heading or curvature. The time of a joint may change even if its state is
    fixed.

    Next to the stops of a route of `fit_route`, whole curves change (see `qtraj.path.progress`): their shape changes
    like that of a segment, and the durations of all segments of a curve are multiplied by the same factor. So the
    vehicle keeps stopping, and the curvature is limited up to the stop. The derivatives in the objective are then those
    with respect to the parameter of the curve. Segments of other routes that touch a stop are not changed.

    `closed`: whether the route is a closed circuit, which must end where it starts. The last joint then has the same
    position, velocity and acceleration as the first joint, and by default no state is fixed. So the limits are proved
    on the whole lap, including the transition to the next lap.

    Limits may change along the way (`Along`), and limits on forces refer to a road that does (`Road`). While the route
    changes, so do the distances: the limits at a node are those at its distance in the last result, and where they
    change in steps, the strictest ones from the previous to the next node. If that search fails, another one takes the
    strictest ones of whole segments. The bank and the friction at a node are those at its distance in the last result,
    and `certify` checks the final route on its own distances.

    Obstacles in `limits.keep_out` are avoided by the whole `body`. Where the given route enters obstacles, the search
    starts on both sides of each of two of them, and on the nearer side of others; the best result is returned. An
    obstacle that moves, as a polynomial of the time since the start of the route, is also passed after it and before
    it. The route must not stop in between then. If obstacles and the tube contradict each other, `advice` says where.

    The search finds local optima. `starts` is the number of its starts, by default the given route alone; each further
    one is a reproducible random route within the tube, and the best result is returned. This pays where obstacles leave
    several ways; without obstacles, it has found nothing better in tests. `method` may be an optax optimiser, which
    takes the first steps from all further starts together; the search then continues from the best four. The first
    steps are compiled in each call, which takes some seconds, so they are for large numbers of starts.

    A `Shape` has no times: first its fastest timing is computed, a flying lap if it is closed, from which the search
    starts. The default objective is "fastest", and `closed` is that of the shape. The tube is by default that of its
    widths, less 1 m on both sides; or `tube` (n, 2) contains the distances [m] to the right and to the left at each
    joint, as in `shape.widths - 1.2`. The reference line then is the middle between the edges, and the tube has half
    of their distance; its vertical half-width is 0.05 m.

    The method is a primal-dual interior-point method with exact second derivatives (Wächter and Biegler 2006). The cost
    of a step is proportional to the number of segments. The method satisfies the limits at eleven instants of each
    segment, with margins for larger values between them. Then `certify` checks whole segments, and the margins are
    reduced until everything is proved, in at most eleven searches (twelve for "fastest") with `max_steps` steps in
    total. If they find no route, they are repeated with matrices without the second derivatives of the constraints,
    where these are violated by much. The result is a local optimum with the code `successful`. The code is
    `not_optimal` if everything is proved but the search stopped before the optimum. Two more codes refer to segments
    that touch a stop and do not change: `broken_at_stops` and `undefined_at_stops`.

    If the limits contradict each other, the code is `limits_contradict`: another search with elastic limits finds a
    route that violates some limits on some segments, and is proved to satisfy all others. `advice` then contains a
    change of the problem with which every limit is satisfied: free states at the ends, a free duration, or higher
    limits, as further searches have proved. If a limited quantity is undefined on a segment that may change, such as
    the yaw rate of a lift, the route does not change, and the code is `limits_undefined`.

    Segments that change become quintics, and position, velocity and acceleration are continuous at their joints, even
    if they jump in the original route. Segments that do not change keep their coefficients and the jumps between them.

    **Derivatives**: under `grad`, `jvp`, `jacfwd` and `jacrev`, `path`, `objective`, `displacement` and `delay` have
    the derivatives of the optimum with respect to the route (the states of its joints and its times), the limits and
    the tube, by the implicit function theorem; obstacles and limits by speed are constants. The derivatives refer to
    the problem of the last search, with limits at its instants and constant margins. They are NaN if that search does
    not converge, or if the limits contradict each other.

    Inside `jit` and `vmap`, the search is one operation that runs on the host, for one route after the other. If the
    times of the joints are traced, too, the number of segments is unknown: arrays with one entry for each segment then
    have one for each row of `route.coefficients`, and `displacement` has one more. Padding is within the tube, counts
    as proved, and is displaced like the last joint. The result has no `advice` and no intervals of violation. Invalid
    numbers lead to the code `route_ill_posed`.

    **Raises:** ValueError for a path that is not a route, a batch (use `jax.vmap`), a traced route in float32, an
    unknown objective, a limit on the natural trihedral (which does not exist on straights), traced arguments with a
    traced vehicle, obstacles or limits by speed, limits that change along the way, a changing road or `nearest_to`;
    inside `jit` and `vmap`, a shape, a traced route with stops of `fit_route`, and a closed route with traced times;
    "fastest" without a limit that bounds the speed, `nearest_to` with another objective, half-widths that are not
    positive, a wrong shape, or a `closed` route that does not end where it starts, has only one segment, or has
    different half-widths at its ends; a fixed end inside an obstacle; for a shape also without widths and tube, with
    edges nearer than the margins, and without a fastest timing. RuntimeError with `throw` if a limit is not proved to
    be satisfied.
    """
    route, limits = in_float64((route, limits))
    if isinstance(route, Shape):
        require_limits(limits)
        objective, closed = objective or "fastest", route.closed
        limited(limits, objective)
        route, tube = route_in_tube(route, limits, tube)
    tube, objective = 0.5 if tube is None else tube, objective or "nearest"
    require_route(route, limits)
    names = limited(limits, objective)
    require_known_road(limits.vehicle, limits.given())
    if nearest_to is not None:
        require_target(nearest_to, objective)
    many = many_starts.many(starts, method, limits)

    def solve(route: Route, limits: Limits, tube: Any) -> Solution:
        return _solution(route, limits, names, tube, objective, fixed, closed, max_steps, nearest_to, many)

    if is_traced(route, limits, tube):
        require_differentiable(limits, nearest_to)
        own = structure(route, limits, names, objective, closed)
        result = differentiable(route, limits, tube, own, solve)
    else:
        result = solve(route, limits, tube).result
    return result.check() if throw else result


def _solution(
    route: Route,
    limits: Limits,
    names: tuple[str, ...],
    tube: Any,
    objective: str,
    fixed: Any,
    closed: bool,
    max_steps: int,
    nearest_to: AbstractHodograph | None,
    many: many_starts.Many,
) -> Solution:
    """Return the result and the search behind it, for concrete arguments."""
    limited(limits, objective)
    posed = Posed.of(route, checked(limits), names, tube, fixed, closed)
    problem = posed.problem(objective)
    if nearest_to is not None:
        problem = problem._replace(target=target.offset(route, posed.given, problem.moving, nearest_to))
    task = posed.task(problem, max_steps)
    found = unchanged = _unchanged(task)
    moving = problem.moving > 0
    undefined = _undefined(found, moving)
    if moving.any() and not undefined and not _fits(task, found, objective, nearest_to):
        begins = [*(around.starts(problem, posed.clear) if posed.clear else [None]), *many.begins(problem)]
        found = no_worse(_searched(posed, task, begins, objective), unchanged)
    advice = _advice(posed, task, found, objective)
    code = ResultCode.limits_undefined if undefined else code_of(found, posed.names)
    result = result_of(posed.given, problem, found, moving, objective, code, advice)
    return Solution(result, found.problem, found.z, found.at, posed.given.curves)


def _fits(task: rounds.Task, found: rounds.Found, objective: str, nearest_to: AbstractHodograph | None) -> bool:
    """Return whether the given route is the solution, because it is smooth, within its limits and the nearest one."""
    smooth = not np.any(task.problem.offset) and not _jumps(task.route, task.given)
    return objective == "nearest" and nearest_to is None and smooth and found.proved


def _searched(posed: Posed, task: rounds.Task, begins: list[Any], objective: str) -> rounds.Found:
    """Return the best result of the searches, and if it violates steps of limits, of those on whole segments, too."""
    order = partial(rank, objective=objective)
    found = rounds.solved(task, begins, order)
    if task.problem.local is None or (found.proved and found.missed is None):
        return found
    problem = posed.with_local_limits(task.problem, whole=True)
    if np.array_equal(problem.local, task.problem.local):  # there are no steps
        return found
    return min(found, rounds.solved(task._replace(problem=problem, whole=True), begins, order), key=order)


def _advice(posed: Posed, task: rounds.Task, found: rounds.Found, objective: str) -> str:
    """Return what helps if limits are missed, as far as it is known."""
    advice = ""
    if found.missed is not None and found.proved:
        if posed.limits.varying:
            advice = "Widen the tube, or relax the limits where they are violated."
        elif found.missed[len(posed.bounds) : -2].any():
            where = around.where_missed(task.problem, found.missed, posed.times)
            advice = (
                f"The obstacles and the tube or other limits contradict each other: {where} of the given route. Widen "
                "the tube there, move its ends, or relax the other limits."
            )
        else:
            fixed_ends = bool(posed.held[[0, -1]].any())
            advice = remedy(posed.numbers, found, objective, fixed_ends, partial(_helps, posed, task))
    if not found.proved or found.missed is not None:
        advice = " ".join(x for x in (advice, unbounded_jumps(posed.names, objective)) if x)
    return advice


def _helps(posed: Posed, task: rounds.Task, change: Change) -> bool:
    """Return whether there is a route that satisfies the limits after a change."""
    problem = posed.changed(change)
    if change.objective == "nearest":
        problem = problem._replace(target=task.problem.target)
    raised = limits_of(change.limits, posed.limits.vehicle, keep_out=posed.limits.keep_out, body=posed.limits.body)
    return rounds.feasible(task._replace(limits=raised, problem=problem))


def _undefined(found: rounds.Found, moving: np.ndarray) -> bool:
    """Return whether a limited quantity is undefined on a segment that may change, such as the yaw rate of a lift."""
    codes = np.asarray(found.judged.certificate.segments.codes)
    return bool((largest_of(found.judged.curves, (codes == UNDEFINED).T * 1.0) > 0)[:, moving].any())


def _jumps(route: Route, given: Parts) -> bool:
    """Return whether position, velocity or acceleration jump at a joint by more than rounding errors."""
    step = float(given.h.mean()) ** np.arange(3)[:, None]
    size = float(np.abs(given.states * step).max())
    return bool(np.any(np.abs(np.asarray(route.jumps())) * step > CONTINUOUS * size))


def _unchanged(task: rounds.Task) -> rounds.Found:
    """Return the given route unchanged, and whether it satisfies its limits and stays within its tube."""
    problem, z = task.problem, np.zeros(task.problem.free.shape)
    judged = rounds.judge(task.route, task.given, task.limits, task.tube, problem, z)
    open_ = rounds.unproved(judged, problem.names, problem.moving > 0)
    return rounds.Found(z, judged, not open_.any(), 0, problem)
