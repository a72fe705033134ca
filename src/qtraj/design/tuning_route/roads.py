"""The parameters of the vehicle and its road at the nodes of the segments, for the search for a route.

A road that changes along the way is that at the distances of the last result: the search ignores that the distances
depend on its variables, and the final route is certified on its own distances.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.setup import Parts
from qtraj.path import pieces
from qtraj.path.distances import distances
from qtraj.path.driving import segments_of
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.route import Route

BETWEEN = 8
"""Number of places in each interval between fine nodes, at which the road is evaluated."""

FRICTION = [RoadParameters._fields.index(name) for name in ("inv_long", "inv_lat")]


def at_fine_nodes(route: Route, limits: Limits, given: Parts) -> Float[np.ndarray, "parameters fine n"] | None:
    """Return the parameters at the fine nodes of each curve on a route, or None if no limit depends on them.

    `given` are the curves of the original route, whose lengths are distributed between their ends as on this route.
    The friction at a node is the smallest up to the neighbouring nodes.
    """
    if not limits.uses_vehicle:
        return None
    vehicle: Any = limits.vehicle
    shape = len(basis.FINE_NODES), len(given.h)
    if vehicle is None or not vehicle.on_changing_road:
        return np.stack([np.broadcast_to(np.asarray(x, float), shape) for x in limits.road(np.float64).numbers])
    segments, on = segments_of(route), distances(route)
    at_ends = on.at(np.append(segments.starts, segments.end))
    start, end = at_ends[given.curves.first], at_ends[given.curves.last + 1]
    s = start + (end - start) * _fractions(given)
    road = RoadOnPath(vehicle, on).at_distances(s.ravel())
    found = np.stack([np.reshape(x, s.shape) for x in road.numbers])
    nodes = found[:, ::BETWEEN].copy()
    for k in range(nodes.shape[1]):
        near = found[FRICTION, max(0, (k - 1) * BETWEEN) : (k + 1) * BETWEEN + 1]
        nodes[FRICTION, k] = near.max(axis=1)
    return nodes


def stricter(road: Any, other: Any) -> Any:
    """Return the parameters `other` with the smaller friction of both; either may be None."""
    if road is None or other is None:
        return other
    found = other.copy()
    found[FRICTION] = np.maximum(road[FRICTION], other[FRICTION])
    return found


def _fractions(given: Parts) -> Float[np.ndarray, "places n"]:
    """Return the fractions of the lengths of the curves at the fine nodes and at places between them."""
    nodes = basis.places(given.curves.composed, len(given.h), fine=True)
    steps = np.arange(0, (len(nodes) - 1) * BETWEEN + 1) / BETWEEN
    first = np.minimum(steps.astype(int), len(nodes) - 2)
    u = nodes[first] + (steps - first)[:, None] * (nodes[first + 1] - nodes[first])
    speeds = np.stack([np.linalg.norm(pieces.values(given.c, x * given.h, 1)[1], axis=-1) for x in u])
    lengths = np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(u, axis=0), axis=0)
    lengths = np.concatenate([np.zeros((1, len(given.h))), lengths])
    return lengths / np.where(lengths[-1] > 0, lengths[-1], 1.0)
