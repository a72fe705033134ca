"""Problems whose body is inside an obstacle at the start or the end of the path, which cannot move."""

from __future__ import annotations

from typing import Any

import numpy as np

from qtraj.design.tuning.clearances import axes_of, in_world
from qtraj.design.tuning.problem import Problem

DEPTH = 1e-9
"""The smallest depth inside an obstacle that is a fault, as a fraction of the length of the path."""


def occurs(problem: Problem, xp: Any) -> Any:
    """Return whether the body of each problem is inside an obstacle at an end; `xp` is the module of the arrays."""
    inside = xp.zeros(problem.speed.shape, bool)
    for depths in _depths(problem, xp).values():
        for depth in depths:
            inside = inside | (depth > DEPTH * problem.speed * problem.duration)
    return inside


def message(problem: Problem) -> str:
    """Return the message for one problem whose body is inside an obstacle."""
    name, depths = max(_depths(problem, np).items(), key=lambda item: max(map(float, item[1])))
    where = ("start", "end")[int(np.argmax(depths))]
    return (
        f"at the {where}, whose position is fixed, the body is inside {name}, by {max(map(float, depths)):.4g} m: move "
        f"the {where} or the obstacle"
    )


def _depths(problem: Problem, xp: Any) -> dict[str, list[Any]]:
    """Return how far [m] the body is inside each obstacle at both ends, whatever its direction there.

    An obstacle that moves counts at the start only, whose time is known.
    """
    own, found = problem.clearances, {}
    if own is None:
        return found
    ends = _ends(problem, xp)
    for x in own.by_name.values():
        point = np.zeros(3) if x.track is None else np.array([c[0] for c in x.track])
        least = float(np.linalg.norm(x.offset)) - x.radius
        positions = [p - xp.broadcast_to(point, p.shape) for p in ends[: 2 if x.track is None else 1]]
        depths = [-least - x.obstacle.distance(p, 0.0 * p[..., 0]) for p in positions]
        found[x.name] = [xp.maximum(a, b) for a, b in zip(found.get(x.name, depths), depths, strict=True)]
    return found


def _ends(problem: Problem, xp: Any) -> list[Any]:
    """Return the positions (*batch, 3) at both ends in world axes."""
    axes = axes_of(problem.placement)
    local = [[x.planar[..., 0], x.planar[..., 1], x.height] for x in (problem.start, problem.end)]
    return [xp.stack(in_world(point, axes), axis=-1) for point in local]
