"""Convert the best search for a route to the result of `tune_route`."""

from __future__ import annotations

import numpy as np

from qtraj.design.tuning_route import rounds
from qtraj.design.tuning_route.curves import joints_of, spread
from qtraj.design.tuning_route.geometry import moved_states
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.design.tuning_route.setup import Parts
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.outcome import ResultCode
from qtraj.path.driving import segments_of
from qtraj.path.route import Route


def rank(found: rounds.Found, objective: str) -> tuple[bool, bool, float]:
    """Return a key that is smaller for a better result."""
    duration = float(found.judged.route.duration)
    value = duration if objective == "fastest" else float(rounds.attained(found.problem, found.z))
    return not found.proved, found.missed is not None, value


def no_worse(found: rounds.Found, given: rounds.Found) -> rounds.Found:
    """Return the `given` route instead of the result of an unfinished search that violates the same limits by more.

    As in all results of searches, `proved` then means that everything besides what is `missed` is proved.
    """
    if found.missed is None or found.optimal:
        return found
    open_ = rounds.unproved(given.judged, given.problem.names, given.problem.moving > 0)
    own, before = (float(rounds.ratios(x.judged, x.problem).max()) for x in (found, given))
    if own <= before or (open_.any(axis=1) & ~found.missed.any(axis=1)).any():
        return found
    return given._replace(proved=True, steps=found.steps, optimal=False, missed=open_)


def result_of(
    given: Parts,
    problem: RouteProblem,
    found: rounds.Found,
    moving: np.ndarray,
    objective: str,
    code: ResultCode,
    advice: str,
) -> TunedRoute:
    """Return the result of a search; `moving` are the segments of the problem that may change."""
    judged = found.judged
    states, h = moved_states(problem, given.states, given.h, found.z)
    duration = float(judged.route.duration)
    return TunedRoute(
        judged.route,
        judged.certificate,
        duration if objective == "fastest" else rounds.attained(problem, found.z),
        spread(given.curves, judged.distances, 0.0),
        spread(given.curves, judged.within.all(axis=1), True),
        _displacement(judged.route, given, states[:, 0] - given.states[:, 0]),
        np.sum(given.stretch * (h - given.h)),
        spread(given.curves, ~moving, False),
        code,
        found.steps,
        advice,
    )


def code_of(found: rounds.Found, names: tuple[str, ...]) -> ResultCode:
    """Return the code of a search for a route with limits of these names."""
    certificate = found.judged.certificate
    if not found.proved:
        if not np.isfinite(found.judged.distances).all():
            return ResultCode.not_finite
        return ResultCode.route_not_converged if found.exhausted else ResultCode.route_not_found
    if found.missed is not None:
        return ResultCode.limits_contradict
    if any(certificate.status[name] not in ("proved", "undefined") for name in names):
        return ResultCode.broken_at_stops
    if not found.optimal:
        return ResultCode.not_optimal
    return ResultCode.successful if certificate.holds else ResultCode.undefined_at_stops


def _displacement(route: Route, given: Parts, of_joints: np.ndarray) -> np.ndarray:
    """Return the displacements of all joints of the route, some of which are inside curves or at a stop."""
    if not given.curves.composed.any():
        return of_joints
    old, new = joints_of(given.segments), joints_of(segments_of(route))
    return new - old
