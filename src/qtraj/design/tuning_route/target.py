"""Another path in place of the original route in the objective "nearest" of the search for a route."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning_route import geometry
from qtraj.design.tuning_route.setup import Parts
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.methods import method
from qtraj.path.distances import distances
from qtraj.path.driving import segments_of
from qtraj.path.equal_arcs import equal_arcs
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.route import Route
from qtraj.path.shape import Shape

POINTS, PER_SEGMENT = 257, 8
"""The spline through a path has at least this number of points, and this number for each segment of the route."""


def require_target(path: Any, objective: str) -> None:
    """Raise a ValueError for anything else than one path with concrete values, and for another objective."""
    require_path(path)
    if objective != "nearest":
        raise ValueError(
            f"nearest_to belongs to objective='nearest', but the objective is {objective!r}: remove one of the two"
        )
    if is_traced(path):
        raise ValueError(
            "the result of tune_route has no derivatives with respect to nearest_to: pass a path with concrete values"
        )
    if np.ndim(path.duration):
        raise ValueError("nearest_to must be one path, but a batch was given: tune the routes one by one")


def offset(route: Route, given: Parts, moving: np.ndarray, path: AbstractHodograph) -> Float[np.ndarray, "6 3 n"]:
    """Return the scaled end states (see `basis`) of `path` minus those of the original route.

    Points at equal fractions of the arc lengths belong to each other. The given path is represented by a spline through
    points at equal distances along it, and is followed at the pace of the route, so its timing does not matter.
    """
    count = max(POINTS, PER_SEGMENT * len(given.h) + 1)
    points = np.asarray(equal_arcs(path, count - 1), float)
    if not np.isfinite(points).all():
        raise ValueError("nearest_to must be a path with finite positions and a finite length, but it has others")
    spline = Shape.through(points, closed=False).route
    segments, on = segments_of(route), distances(route)
    at = on.at(np.append(segments.starts, segments.end))
    fractions = np.append(at[given.curves.first], at[given.curves.last[-1] + 1]) / on.length
    own = given.states
    speed = np.linalg.norm(own[:, 1], axis=1)
    growth = np.einsum("nc,nc->n", own[:, 1], own[:, 2]) / np.where(speed > 0, speed, 1.0)
    last = float(np.asarray(spline.duration))
    position, first, second = (np.asarray(x, float) for x in method(spline, "sampled")(fractions * last, 2))
    pace, faster = (last / on.length * x[:, None] for x in (speed, growth))
    target = np.stack([position - np.asarray(route.origin), pace * first, pace**2 * second + faster * first], axis=1)
    both = np.concatenate([(target - own)[:-1], (target - own)[1:]], axis=1)
    scaled = both * (given.h[:, None] ** np.array([geometry.basis.POWERS], float))[:, :, None]
    return np.moveaxis(np.where(moving[:, None, None] > 0, scaled, 0.0), 0, -1)
