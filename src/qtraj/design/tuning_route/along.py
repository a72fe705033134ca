"""Limits that change along the way, for the search for a route: the strictest value on each segment."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.along import Along, Changing
from qtraj.design.ellipse import Ellipse, OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.curves import Curves, largest_of
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.path.distances import distances
from qtraj.path.driving import segments_of
from qtraj.path.quantity import quantity
from qtraj.path.route import Route

ABSENT = 1e4
"""Where there is no limit, the search imposes this multiple of the typical value."""


def changes(limits: Limits) -> bool:
    """Return whether a limit changes along the way."""
    given = limits.given()
    return any(not isinstance(given[name], OfSpeed) for name in limits.varying)


def typical(limits: Limits) -> Float[np.ndarray, " limits"]:
    """Return the limits; the strictest value of each limit that changes along the way or with the speed."""
    return np.array([typical_of(name, bound) for name, bound in limits.given().items()])


def typical_of(name: str, bound: Any) -> float:
    """Return a limit, or its strictest value if it changes."""
    if isinstance(bound, Ellipse):
        return 1.0
    if not isinstance(bound, Changing):
        return float(np.asarray(bound))
    values, side = np.asarray(bound.values, float), quantity(name).side
    known = values[np.isfinite(values)]
    return float(side * np.min(side * known)) if known.size else side * 1.0


def local_squares(
    route: Route, limits: Limits, curves: Curves, closed: bool, obstacles: int = 0, whole: bool = False
) -> Float[np.ndarray, "limits fine n"]:
    """Return the squares of the limits at the fine nodes of each curve.

    Where steps change, a node has the strictest value up to its neighbours: those at which limits are imposed for a
    node at which they are, so the stricter value begins before the step. Linear limits have their values. Steps if
    `whole` is true, and both kinds on curves with a progress, whose nodes move more, have the strictest value of the
    curve; the first node belongs to the previous curve, too, and on a `closed` route, the last curve is before the
    first one. The last rows are those of constraints on `obstacles`.
    """
    limits = limits.on(route)
    segments, on = segments_of(route), distances(route)
    s = on.at(np.append(segments.starts, segments.end))
    u = segments.starts[:, None] + segments.durations[:, None] * basis.FINE_NODES
    at_nodes = on.at(u.ravel()).reshape(u.shape)[curves.first]
    before, after = _neighbours(at_nodes)
    found = []
    for (name, bound), usual in zip(limits.given().items(), typical(limits), strict=True):
        side, sign, usual = quantity(name).side, _strictness(name), _tangent(name, usual)
        if not isinstance(bound, Along):
            found.append(np.full(at_nodes.T.shape, usual**2))
            continue
        strictest = _tangent(name, bound.strictest(s[:-1] - on.uncertainty, s[1:] + on.uncertainty, side))
        absent = abs(usual) / ABSENT if sign > 0 else ABSENT * abs(usual)
        own = largest_of(curves, sign * np.where(np.isinf(strictest), absent, strictest)[None] ** 2)[0]
        rows = np.repeat(own[None], len(basis.FINE_NODES), axis=0)
        rows[0] = np.maximum(own, np.roll(own, 1) if closed else np.append(own[:1], own[:-1]))
        if bound.kind == "linear":
            nearest = bound.at(at_nodes.ravel())
        else:
            nearest = bound.strictest(before.ravel() - on.uncertainty, after.ravel() + on.uncertainty, side)
        nearest = _tangent(name, nearest)
        nearest = sign * np.where(np.isinf(nearest), absent, nearest).reshape(at_nodes.shape).T ** 2
        rows = np.where(curves.composed | (whole and bound.kind == "step"), rows, nearest)
        found.append(np.abs(rows))
    found += [np.ones(at_nodes.T.shape)] * obstacles
    return np.stack(found)


def _neighbours(s: Float[np.ndarray, "n fine"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances [m] at the neighbours of fine nodes, those of a node with limits at a whole cell from it."""
    at, last = np.arange(s.shape[1]), s.shape[1] - 1
    far = np.where(at % basis.FINER == 0, basis.FINER, 1)
    before, after = s[:, np.maximum(at - far, 0)], s[:, np.minimum(at + far, last)]
    before[1:, 0], after[:-1, last] = s[:-1, -1 - basis.FINER], s[1:, basis.FINER]
    return before, after


def _tangent(name: str, bounds: Any) -> Any:
    """Return the limits on the ratio of a quantity (see `PathQuantity.tangent`); infinite ones mean no limit."""
    known = np.asarray(bounds, float)
    finite = np.isfinite(known)
    return np.where(finite, np.asarray(quantity(name).tangent(np.where(finite, known, 0.0))), known)


def stricter(problem: RouteProblem, local: Float[np.ndarray, "limits fine n"]) -> Float[np.ndarray, "limits fine n"]:
    """Return the stricter ones of the squared limits of the problem and of others."""
    signs = np.array([_strictness(name) for name in problem.names])[:, None, None]
    return np.abs(np.maximum(signs * problem.local, signs * local))


def _strictness(name: str) -> float:
    """Return the factor with which larger squares of limits are stricter: 1 for a lower bound on a magnitude."""
    entry = quantity(name)
    return 1.0 if entry.lower and not entry.bounds_side else -1.0
