"""Tune within tightened limits, so that the limits are proved for all deviations in a box."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.robust.box import Box
from qtraj.design.robust.box_certificate import BoxCertificate
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.box_problem import BoxProblem, strictest
from qtraj.design.robust.driven import bounds_of
from qtraj.design.robust.route_box import RouteBoxProblem
from qtraj.design.robust.tightened import tightened
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.outcome import ResultCode

MAX_ROUNDS = 16
"""Maximum number of tunings."""

GAP = 1e-6
"""Relative distance from the limits at which the worst values are aimed, so that the proof is short."""

CLOSE = 1e-3
"""Largest relative distance of the worst values from the limits that needs no further tuning."""


def tune_in_box(
    solve: Callable[[Limits], Any],
    around: Callable[[Any], BoxProblem | RouteBoxProblem],
    limits: Limits,
    box: Box,
) -> BoxTuned:
    """Return the result of `solve` within limits so tight that `certify_box` proves them; see `robust_tune`.

    `solve` tunes within limits, and `around` returns the problem of the paths near its result.
    """
    strict = strictest(limits, box)
    bounds, sides, _ = bounds_of(strict)
    aims = bounds - sides * GAP * np.maximum(np.abs(bounds), 1e-3)
    extra = np.zeros((0, len(box.names)))
    tuned, tight, margins, rounds = solve(strict), strict, np.zeros(len(bounds)), 1
    while True:
        if not tuned.converged:
            return BoxTuned(tuned, tight, None, rounds, int(tuned.code))
        problem = around(tuned)
        points = np.concatenate([problem.grid(), extra])
        reached, nominal = _worst(problem, points, sides)
        excess = sides * (reached - aims) / np.maximum(np.abs(bounds), 1e-3)
        unused = (
            (margins > 0) & (excess < -CLOSE) & (sides * (nominal - (aims - sides * margins)) > -1e-6 * np.abs(bounds))
        )
        settled = (excess <= 0.5 * GAP).all() and not unused.any()
        certificate = problem.certificate() if settled or rounds == MAX_ROUNDS else None
        if certificate is not None and (certificate.holds or rounds == MAX_ROUNDS):
            return _outcome(tuned, tight, certificate, rounds)
        if certificate is not None:
            found = _counterexamples(certificate)
            if not len(found) or (found[:, None] == points).all(axis=-1).any(axis=1).all():
                return _outcome(tuned, tight, certificate, rounds)
            extra = np.concatenate([extra, found])
            continue
        margins = np.maximum(sides * (reached - nominal), 0.0) + np.where(excess > 0, 0.1 * GAP * np.abs(bounds), 0.0)
        closer = tightened(strict, margins + sides * (bounds - aims))
        if closer is None:
            return BoxTuned(tuned, tight, None, rounds, int(ResultCode.infeasible))
        tight, rounds = closer, rounds + 1
        tuned = solve(tight)


def _worst(
    problem: BoxProblem | RouteBoxProblem, points: np.ndarray, sides: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the worst values at some deviations and the values without deviations."""
    nominal = problem.values(np.zeros((1, points.shape[1])))[1][0]
    values = problem.values(points)[1]
    return sides * np.max(sides * np.where(np.isnan(values), sides * np.inf, values), axis=0), nominal


def _counterexamples(certificate: BoxCertificate) -> np.ndarray:
    unmet = [k for k, status in enumerate(certificate.status.values()) if status != "proved"]
    return np.asarray(certificate.deviations)[unmet]


def _outcome(tuned: Tuned | TunedRoute, tight: Limits, certificate: BoxCertificate, rounds: int) -> BoxTuned:
    code = ResultCode(int(tuned.code)) if certificate.holds else ResultCode.not_converged
    return BoxTuned(tuned, tight, certificate, rounds, int(code))
