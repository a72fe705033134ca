"""Repeat the search until every limit and the tube are proved to be satisfied on every segment that may change.

A search satisfies the limits at nodes, with margins for larger values between them (`refreshed`). Then whole segments
are certified. Where a proof is missing, the margins are reduced a little, and another search starts from the last
solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.obstacles.certificate import with_obstacles
from qtraj.design.proof.certificate import PROVED
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.solve import nonconvex
from qtraj.design.solve.nonconvex import FREE, Iterate, Rules, Search
from qtraj.design.tuning_route import along, geometry, roads
from qtraj.design.tuning_route.constraints import relative
from qtraj.design.tuning_route.curves import Curves, largest_of
from qtraj.design.tuning_route.problem import RouteProblem, objective, segments, squared_jerk
from qtraj.design.tuning_route.program import RouteProgram
from qtraj.design.tuning_route.setup import Parts
from qtraj.design.tuning_route.tube import Displacement
from qtraj.path.route import Route

ROUNDS = 10
"""Maximum number of repeated searches."""

BARRIER, LEAST = 0.1, 1e-7
"""The barrier parameter at the start, relative to the price of violations if there is one, and at the end of a search.
At the end, the objective exceeds its minimum by at most about `LEAST` times the number of constraints."""

AGAIN = (1e-7, 1e-3)
"""Bounds to which the initial barrier parameter of a repeated search, the largest relative violation, is clipped."""

ROUGH, SMOOTHING = 1e-3, 1e-3
"""The fastest route is not unique: on a straight, for example, many lines take the same time. Therefore
the search adds a term proportional to the integral of the squared jerk once the barrier parameter has reached `ROUGH`.
At that point the term is the fraction `SMOOTHING` of the duration."""

PRICES, SHARP = (3e2, 3e3), 1e-4
"""The prices of violations, one after the other, if the limits contradict each other (steps with a high price are short
far from the solution), and the first barrier parameter of the second search, relative to its price."""

VIOLATED = 1e-5
"""A limit counts as violated if the squared quantity exceeds the squared limit by more than this fraction of it."""

VISIBLE, RAISED = 1.003, 1.01
"""After an unfinished search, limits that are violated by more than the first factor are raised by the second one."""

SAFETY = 2e-5
"""Margins are reduced by this fraction, which doubles with each repetition."""


class Task(NamedTuple):
    """A route to tune, its parts, its limits, the half-widths `tube` (n + 1, 2) at the joints [m], and the problem.

    `most` is the largest number of steps of a search, and of a second one together with it. `convex`: see `Rules`. With
    `whole`, steps of limits that change along the way have the strictest value of the curve.
    """

    route: Route
    given: Parts
    limits: Limits
    tube: np.ndarray
    problem: RouteProblem
    most: int
    convex: bool = False
    whole: bool = False


class Judged(NamedTuple):
    """A route with its certificate.

    `curves` relates the segments of the route to its curves. `within` (curves, 2): whether the horizontal and the
    vertical distance are proved to be within the tube. `distances` (curves, 2) [m]: the largest horizontal and vertical
    distances.
    """

    route: Route
    certificate: RouteCertificate
    within: np.ndarray
    distances: np.ndarray
    curves: Curves


class Found(NamedTuple):
    """The variables, the certified route, and whether the limits are `proved` on all segments that may change.

    `optimal`: whether the last search converged. `exhausted`: whether a search stopped because no steps were left.
    `at`: the last iterate; None if there was no search. `problem`: the problem of the last search. `missed` (limits +
    2, segments): the limits that cannot be satisfied together on a segment, or None. `indefinite`: see `Search`.
    """

    z: Any
    judged: Judged
    proved: bool
    steps: int
    problem: RouteProblem
    optimal: bool = True
    exhausted: bool = False
    at: Iterate | None = None
    missed: np.ndarray | None = None
    indefinite: bool = False


def solved(task: Task, begins: list[Any], rank: Callable[[Found], Any]) -> Found:
    """Return the tuned route with the lowest rank.

    Searches start from each of the variables `begins`; None are those of the given route. If limits contradict each
    other from all of them, they are violated as little as possible.
    """
    each = [_attempted(task, begin) for begin in begins]
    if not any(x.proved for x in each):
        each = [_violating(x, task, begin) for begin, x in zip(begins, each, strict=True)]
    return min(each, key=rank)


def _attempted(task: Task, begin: np.ndarray | None) -> Found:
    """Return the result of a search, and of a second one with convex matrices if the first one found no proved route.

    The second one also reaches routes that are far away. It is omitted where it would repeat the first one.
    """
    found = _solved(task, begin=begin)
    if found.proved or found.exhausted or not found.indefinite or found.steps >= task.most:
        return found
    other = _solved(task._replace(convex=True, most=task.most - found.steps), begin=begin)
    return (other if other.proved else found)._replace(steps=found.steps + other.steps)


def _violating(found: Found, task: Task, begin: np.ndarray | None) -> Found:
    """Return the result of searches that may violate limits, after a search that `found` no proved route."""
    problem = task.problem
    if found.exhausted or not problem.names:
        return found
    relaxed = _solved(task, PRICES[0], begin=begin)
    steps = found.steps + relaxed.steps
    if relaxed.proved and relaxed.missed is not None:
        sharper = _solved(task, PRICES[1], relaxed.at)
        steps += sharper.steps
        relaxed = sharper if sharper.proved else relaxed
    elif relaxed.missed is not None:
        repeated = _solved(task, raised=_raised(relaxed, problem))
        steps += repeated.steps
        if repeated.proved:
            open_ = unproved(repeated.judged, problem.names, problem.moving > 0)
            relaxed = repeated._replace(optimal=False, missed=open_)
    return relaxed._replace(steps=steps)


def _raised(found: Found, problem: RouteProblem) -> np.ndarray:
    """Return factors (limits + 2, n) on the squared limits, with which an unfinished search could violate them."""
    moving = problem.moving > 0
    open_ = unproved(found.judged, problem.names, moving)
    open_[-2:] = False
    ratio = ratios(found.judged, problem)
    own = np.where(open_ & (ratio > VISIBLE), (RAISED * ratio) ** 2, 1.0)
    # A joint is constrained in one of its segments only, so the neighbours are raised, too.
    wide = np.pad(own, [(0, 0), (1, 1)], constant_values=1.0)
    return np.maximum(own, np.maximum(wide[:, :-2], wide[:, 2:]))


def ratios(judged: Judged, problem: RouteProblem) -> np.ndarray:
    """Return the largest values of the limited quantities relative to their limits, and 1 for the tube."""
    worst, names = judged.certificate.segments.worst, problem.names
    values, limits = (np.reshape([np.asarray(worst[name][k]) for name in names], (len(names), -1)) for k in (1, 2))
    found = largest_of(judged.curves, relative(names, values, limits, problem.shifts))
    return np.concatenate([np.nan_to_num(found, nan=1.0), np.ones((2, found.shape[1]))])


def feasible(task: Task) -> bool:
    """Return whether a search finds a route that satisfies every limit."""
    return _solved(task).proved


def _solved(
    task: Task,
    price: float | None = None,
    start: Iterate | None = None,
    raised: np.ndarray | None = None,
    begin: np.ndarray | None = None,
) -> Found:
    """Return the tuned route; with a `price`, limits may be violated. `start` is the result of a lower price.

    `raised` (limits + 2, n) are factors on the squared limits; those above 1 need not be proved.
    """
    problem, limits, most = task.problem, task.limits, task.most
    names, moving = problem.names, problem.moving > 0
    factor = np.ones((len(names) + 2, len(moving))) if raised is None else raised
    program, missed = RouteProgram(problem, price), factor > 1
    mu, k = BARRIER * (price or 1.0), 0
    if start is None:
        rules = _rules(task, program, factor, LEAST)
        state = Search(
            nonconvex.start(program, np.zeros(problem.free.shape) if begin is None else begin, rules.factor, mu), mu
        )
    else:
        mu = SHARP * (price or 1.0)
        state = Search(nonconvex.restarted(program, start, mu), mu, renewals=FREE)
    if np.any(problem.time):
        state = nonconvex.solve(program, state, _rules(task, program, factor, ROUGH), most)
        problem, at = _smoothed(problem, state.at.z), state.at
        if price is not None and not _violated(program, at).any():
            price, at = None, at._replace(excess=None)
        program = RouteProgram(problem, price)
        state = replace(Search(at, ROUGH), steps=state.steps, hopeless=state.hopeless, indefinite=state.indefinite)
    while True:
        rules = _rules(task, program, factor * (1 - SAFETY * 2.0**k), LEAST, first=k == 0)
        if k:
            state = _again(program, state, rules, mu)
        state = nonconvex.solve(program, state, rules, most)
        judged = judge(task.route, task.given, limits, task.tube, problem, state.at.z)
        missed |= _violated(program, state.at) & moving
        unproved_ = unproved(judged, names, moving)
        if limits.varying or limits.along_road:  # the search imposes stricter limits than the given ones
            missed &= unproved_
        open_ = unproved_ & ~missed
        exhausted = state.steps >= most and not (state.done or state.stuck or state.hopeless)
        last = missed if missed.any() else None, state.indefinite
        found = Found(state.at.z, judged, not open_.any(), state.steps, problem, state.done, exhausted, state.at, *last)
        given_up = state.steps >= most or state.hopeless or not np.isfinite(judged.distances).all()
        if found.proved or k == ROUNDS or given_up:
            return found
        above = ratios(judged, problem)
        above[-2:] = np.nan_to_num((judged.distances / task.tube[:-1]).T, nan=1.0)
        above = np.clip(above, 1.0, 1.02)
        mu = float(np.clip(np.max(np.where(open_, above - 1, 0.0)), *AGAIN))
        factor = factor * np.where(open_, above, 1.0) ** -2
        if problem.local is not None:  # the distances have changed with the route
            curves, closed = task.given.curves, problem.seam is not None
            own = along.local_squares(judged.route, limits, curves, closed, len(problem.clear), task.whole)
            problem = problem._replace(local=along.stricter(problem, own))
            program = RouteProgram(problem, price)
        if limits.along_road:
            road = roads.at_fine_nodes(judged.route, limits, task.given)
            problem = problem._replace(road=roads.stricter(problem.road, road))
            program = RouteProgram(problem, price)
        k += 1


def _violated(program: RouteProgram, at: Iterate) -> np.ndarray:
    """Return whether a limit is violated at a node of a segment (limits + 2, n)."""
    shape = program.problem.used.shape
    if at.excess is None:
        return np.zeros((shape[0], shape[2]), bool)
    return program.spread(at.excess)[0].max(axis=1) > VIOLATED


def _rules(task: Task, program: RouteProgram, factor: np.ndarray, least: float, first: bool = True) -> Rules:
    """Return the rules of a search whose margins are multiplied by `factor` (constraints, n).

    If the objective is "fastest", then in the searches before the first repetition all iterates after an iterate that
    satisfies the limits at the nodes satisfy them, too.
    """
    used = program.problem.used
    flat = program.flat(np.broadcast_to(factor[:, None], used.shape), np.ones((2, used.shape[2])))
    return Rules(flat, least, first and bool(np.any(program.problem.time > 0)), task.convex)


def _again(program: RouteProgram, state: Search, rules: Rules, mu: float) -> Search:
    """Return the start of a repeated search, with new margins, slacks and multipliers."""
    at = state.at
    margins = np.minimum(at.margins, program.refreshed(at.z, at.margins) * rules.factor)
    at = nonconvex.restarted(program, at._replace(margins=margins), mu)
    return Search(at, mu, steps=state.steps, renewals=FREE, indefinite=state.indefinite)


def _smoothed(problem: RouteProblem, z: np.ndarray) -> RouteProblem:
    """Return the problem of the fastest route with the term that makes its solution unique."""
    s = segments(problem, z)
    jerk, duration = np.sum(problem.moving * s.h**-5 * squared_jerk(s)), np.sum(s.h * problem.moving)
    return problem._replace(jerk=problem.moving * SMOOTHING * duration / jerk)


def attained(problem: RouteProblem, z: np.ndarray) -> Any:
    """Return the objective in the units of `tune_route`; for "fastest", without the segments that do not change."""
    return objective(problem, segments(problem, z)) * problem.unit


def judge(route: Route, given: Parts, limits: Limits, tube: np.ndarray, problem: RouteProblem, z: np.ndarray) -> Judged:
    """Return the certified route for the variables `z`."""
    c, h = geometry.changed(problem, given.c, given.h, given.states, z)
    new = given.rebuilt(c, h, np.asarray(route.origin))
    displacement = Displacement(c, h, given.c, given.h)
    certificate = with_obstacles(certify_route(new, limits), new, limits)
    return Judged(new, certificate, displacement.within(tube), displacement.largest(), given.curves)


def unproved(judged: Judged, names: tuple[str, ...], moving: np.ndarray) -> np.ndarray:
    """Return whether the proof for each limit, then for both distances, is missing on each curve that may change."""
    codes = np.asarray(judged.certificate.segments.codes)
    order = [judged.certificate.names.index(name) for name in names]
    missing = largest_of(judged.curves, (codes[:, order].T != PROVED) * 1.0) > 0
    return np.concatenate([missing, ~judged.within.T]) & moving
