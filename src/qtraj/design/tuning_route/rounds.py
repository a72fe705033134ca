"""Repeat the search until every limit and the tube are proved to be satisfied on every segment that may change.

A search satisfies the limits at nodes, with margins for larger values between them (`refreshed`). Then whole segments
are certified. Where a proof is missing, the margins are reduced a little, and another search starts from the last
solution.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import PROVED
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.tuning_route import geometry, interior
from qtraj.design.tuning_route.constraints import Names
from qtraj.design.tuning_route.interior import FREE, Search
from qtraj.design.tuning_route.margins import refreshed
from qtraj.design.tuning_route.newton import Iterate, Rows, excess_of, used
from qtraj.design.tuning_route.problem import RouteProblem, objective, segments
from qtraj.design.tuning_route.setup import Parts
from qtraj.design.tuning_route.tube import Displacement
from qtraj.path.route import Route, from_segments

ROUNDS = 10
"""Maximum number of repeated searches."""

BARRIER, LEAST = 0.1, 1e-7
"""The barrier parameter at the start and at the end of a search. At the end, the objective exceeds its minimum by at
most about `LEAST` times the number of constraints."""

AGAIN = (1e-7, 1e-3)
"""Bounds to which the initial barrier parameter of a repeated search, the largest relative violation, is clipped."""

ROUGH, SMOOTHING = 1e-3, 1e-3
"""The fastest route is not unique: on a straight, for example, many lines take the same time. Therefore
the search adds a term proportional to the integral of the squared jerk once the barrier parameter has reached `ROUGH`.
At that point the term is the fraction `SMOOTHING` of the duration."""

SAFETY = 2e-5
"""Margins are reduced by this fraction, which doubles with each repetition."""


class Judged(NamedTuple):
    """A route with its certificate.

    `within` (segments, 2): whether the horizontal and the vertical distance are proved to be within the tube.
    `distances` (segments, 2) [m]: the largest horizontal and vertical distances.
    """

    route: Route
    certificate: RouteCertificate
    within: np.ndarray
    distances: np.ndarray


class Found(NamedTuple):
    """The variables, the certified route, and whether the limits are `proved` on all segments that may change.

    `optimal`: whether the last search converged. `exhausted`: whether a search stopped because no steps were left.
    `at`: the last iterate; None if there was no search. `problem`: the problem of the last search.
    """

    z: Any
    judged: Judged
    proved: bool
    steps: int
    problem: RouteProblem
    optimal: bool = True
    exhausted: bool = False
    at: Iterate | None = None


@eqx.filter_jit
def search(
    names: Names, problem: RouteProblem, at: Iterate, factor: Any, mu: Any, least: Any, most: Any, renewals: Any
) -> Search:
    """Call `interior.solve`, compiled.

    If the objective is "fastest", then in the searches before the first repetition all iterates after an iterate that
    satisfies the limits at the nodes satisfy them, too.
    """
    inside = jnp.any(problem.time > 0) & (renewals == 0)
    return interior.solve(names, problem, at, factor, mu, least, most, renewals, inside)


@eqx.filter_jit
def _smoothed(problem: RouteProblem, z: Any) -> RouteProblem:
    """Return the problem of the fastest route with the term that makes its solution unique."""
    jerk = objective(problem._replace(time=0 * problem.time, jerk=problem.moving), z)
    duration = jnp.sum(segments(problem, z).h * problem.moving)
    return problem._replace(jerk=problem.moving * SMOOTHING * duration / jerk)


@eqx.filter_jit
def _prepared(names: Names, problem: RouteProblem, at: Iterate, factor: Any, mu: Any) -> Iterate:
    """Return the initial iterate of the next search, with new margins, slacks and multipliers."""
    margins = jnp.minimum(at.margins, refreshed(names, problem, at.z, at.margins) * factor)
    excess = excess_of(names, problem, segments(problem, at.z), margins)

    def slack(g: Any, m: Any, u: Any) -> Any:
        return jnp.where(u > 0, jnp.maximum(-g, mu / jnp.maximum(m, 1e-3)), 1.0)

    count = used(problem)
    slacks = jax.tree.map(slack, excess, at.multipliers, count)
    multipliers = jax.tree.map(lambda s, u: u * mu / s, slacks, count)
    return Iterate(at.z, Rows(*slacks), Rows(*multipliers), margins)


@eqx.filter_jit
def attained(problem: RouteProblem, z: Any) -> Any:
    """Return the objective in the units of `tune_route`; for "fastest", without the segments that do not change."""
    return objective(problem, z) * problem.unit


def solved(
    route: Route, given: Parts, names: Names, limits: Limits, tube: np.ndarray, problem: RouteProblem, most: int
) -> Found:
    """Return the tuned route; `tube` (n + 1, 2) are the half-widths at the joints [m]."""
    n, count = problem.durations.shape[0], len(given.h)
    moving = np.asarray(problem.moving)[:count] > 0
    bounds = np.sqrt(np.asarray(problem.squares))
    factor = np.ones((len(names) + 2, 1, n))
    at, mu, steps, k = _start(names, problem), BARRIER, 0, 0
    if np.any(np.asarray(problem.time)):
        first = search(names, problem, at, factor, *map(np.asarray, (mu, ROUGH, most, 0)))
        at, mu, steps = first.at, ROUGH, int(first.steps)
        problem = _smoothed(problem, at.z)
    while True:
        safe = jnp.asarray(factor * (1 - SAFETY * 2.0**k))
        if k:
            at = _prepared(names, problem, at, safe, np.asarray(mu, float))
        state = search(names, problem, at, safe, *map(np.asarray, (float(mu), LEAST, most - steps, min(k, 1) * FREE)))
        at, steps = state.at, steps + int(state.steps)
        judged = judge(route, given, limits, tube, problem, np.asarray(at.z))
        open_ = unproved(judged, names, moving)
        exhausted = steps >= most and not bool(state.done | state.stuck)
        found = Found(at.z, judged, not open_.any(), steps, problem, bool(state.done), exhausted, at)
        if found.proved or k == ROUNDS or steps >= most or not np.isfinite(judged.distances).all():
            return found
        values = [judged.certificate.segments.worst[name][1] for name in names]
        above = np.stack([*(np.array(values) / bounds[:, None]), *(judged.distances / tube[:-1]).T])
        above = np.clip(np.nan_to_num(above, nan=1.0), 1.0, 1.02)
        mu = float(np.clip(np.max(np.where(open_, above - 1, 0.0)), *AGAIN))
        factor[:, 0, :count] *= np.where(open_, above, 1.0) ** -2
        k += 1


@eqx.filter_jit
def _start(names: Names, problem: RouteProblem) -> Iterate:
    z = jnp.zeros_like(problem.free)
    return interior.start(names, problem, z, jnp.ones_like(problem.used), BARRIER)


def judge(route: Route, given: Parts, limits: Limits, tube: np.ndarray, problem: RouteProblem, z: np.ndarray) -> Judged:
    """Return the certified route for the variables `z`."""
    c, h = geometry.changed(problem, given.c, given.h, given.states, z)
    starts = np.append(0.0, np.cumsum(h))
    h = np.diff(starts)
    new = from_segments(starts[:-1], c, np.asarray(starts[-1]), np.asarray(route.origin))
    displacement = Displacement(np.asarray(new.coefficients)[: len(h)], h, given.c, given.h)
    return Judged(new, certify_route(new, limits), displacement.within(tube), displacement.largest())


def unproved(judged: Judged, names: Names, moving: np.ndarray) -> np.ndarray:
    """Return whether the proof for each limit, then for both distances, is missing on each segment that may change."""
    codes = np.asarray(judged.certificate.segments.codes)
    order = [judged.certificate.names.index(name) for name in names]
    return np.concatenate([codes[:, order].T != PROVED, ~judged.within.T]) & moving
