"""Add the findings on obstacles to the certificate of a path."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.obstacles.body import POINT
from qtraj.design.obstacles.intervals import intervals
from qtraj.design.obstacles.keep_out import checked, clearances_at
from qtraj.design.obstacles.proof import judged
from qtraj.design.obstacles.route_pieces import route_pieces
from qtraj.design.obstacles.turning_pieces import turning_pieces
from qtraj.design.proof.certificate import BROKEN, SAMPLED, Certificate
from qtraj.design.proof.findings import Findings
from qtraj.design.proof.maxima import find_maxima
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.proof.route_segments import RANK
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.arrays import is_traced
from qtraj.path.clearance_quantity import name_of_obstacle
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.shape import Shape

GRID = np.linspace(0.0, 1.0, 2049)
"""The fractions of the duration at which a path that is not polynomial is sampled."""


def with_obstacles(found: Any, path: AbstractHodograph | Shape, limits: Limits) -> Any:
    """Return the certificate with a finding for each obstacle of `limits`; unchanged without obstacles.

    **Raises:** ValueError for a batch, inside a trace, and for obstacles that move and a path without times.
    """
    if limits.keep_out is None:
        return found
    if is_traced(path, limits):
        raise ValueError(
            "certify with obstacles needs concrete values: call it outside jit, grad and vmap. "
            "qtraj.clearance is differentiable"
        )
    limits = checked(limits)
    obstacles: Any = limits.keep_out
    body = limits.body or POINT
    own: Any = path.route if isinstance(path, Shape) else path
    if own.duration.ndim:
        raise ValueError("certify with obstacles accepts one path: call it once for each path of the batch")
    moves = any(x.moves for x in obstacles)
    if moves and isinstance(path, Shape):
        raise ValueError("a shape has no times, so obstacles that move cannot be checked: certify its timing instead")
    if isinstance(path, RetimedPath):
        if not moves and (pieces := _pieces(path.path, limits)) is not None:
            whole = _whole(judged(pieces, obstacles, body))
            return _joined(found, whole._replace(times=np.asarray(path.timing.times_of(whole.times))))
        return _joined(found, _sampled(path, limits))
    pieces = _pieces(own, limits)
    if pieces is None:
        return _joined(found, _sampled(own, limits))
    parts = judged(pieces, obstacles, body)
    if not isinstance(found, RouteCertificate):
        return _joined(found, _whole(parts))
    count = len(found.names)
    broken = [(count + j, x) for j, x in intervals(pieces, parts, obstacles, body)]
    return RouteCertificate(
        _joined(found.whole, _whole(parts)),
        _joined(found.segments, parts),
        found.starts,
        np.concatenate([np.asarray(found.broken), np.reshape([x for _, x in broken], (-1, 2))]),
        np.append(np.asarray(found.broken_limits), [j for j, _ in broken]),
    )


def _pieces(path: AbstractHodograph, limits: Limits) -> Any:
    turns = limits.body is not None and limits.body.turns
    if isinstance(path, Route):
        return route_pieces(path, any(x.moves for x in limits.keep_out or ()), turns)
    return turning_pieces(path, turns)


def _whole(parts: Findings) -> Findings:
    """Return the worst finding on each obstacle (obstacles,)."""
    rank = RANK[parts.codes]
    own = np.where(rank == rank.max(axis=0), parts.values, np.inf)
    row, column = np.argmin(own, axis=0), np.arange(parts.codes.shape[1])
    return Findings(*(x[row, column] for x in parts))


def _sampled(path: AbstractHodograph, limits: Limits) -> Findings:
    """Return the findings on a path that is not polynomial, by refined sampling."""
    duration, obstacles = float(np.asarray(path.duration)), limits.keep_out or ()
    codes, times, values = [], [], []
    for obstacle in obstacles:

        def clearances(u: np.ndarray, obstacle: Any = obstacle) -> np.ndarray:
            t = np.clip(np.asarray(u, float), 0.0, 1.0) * duration
            found = clearances_at([obstacle], limits.body, path, t.ravel())
            return -np.asarray(found[name_of_obstacle(0)], float).reshape(t.shape)

        at, value = find_maxima(clearances, GRID, clearances(GRID[:, None]))
        value = -value[0]
        codes.append(SAMPLED if value >= 0 else BROKEN)
        times.append(float(np.clip(at[0], 0.0, 1.0)) * duration)
        values.append(value)
    return Findings(np.array(codes, np.int32), np.array(times), np.array(values))


def _joined(found: Certificate, own: Findings) -> Certificate:
    names = tuple(name_of_obstacle(k) for k in range(own.codes.shape[-1]))
    join: Callable[..., Any] = lambda a, b: np.concatenate([np.asarray(a), b], axis=-1)  # noqa: E731
    return Certificate(
        (*found.names, *names),
        join(found.codes, own.codes),
        join(found.times, own.times),
        join(found.values, own.values),
        join(found.limits, np.zeros_like(own.values)),
    )
