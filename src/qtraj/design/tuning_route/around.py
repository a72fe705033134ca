"""Obstacles in the search for a route: their constraints, and starts of the search on both sides of them."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.obstacles.clear import Clear
from qtraj.design.obstacles.keep_out import clearances_at
from qtraj.design.tuning_route import basis, cleared, retimed
from qtraj.design.tuning_route.constraints import derivatives
from qtraj.design.tuning_route.problem import RouteProblem, segments
from qtraj.path.driving import Driving
from qtraj.path.route import Route

BOTH_SIDES = 2
"""For this number of obstacles, all combinations of sides are tried; the others are passed on the nearer side."""

SHIFTS = np.linspace(0.0, 1.0, 21)[1:]
"""Trial shifts of the route to one side, as fractions of the half-width of the tube."""


def require_possible(route: Route, limits: Limits, held: np.ndarray) -> None:
    """Raise a ValueError if the body is inside an obstacle at a fixed end, or for obstacles that are not supported."""
    obstacles = limits.keep_out or ()
    if limits.body is not None and limits.body.turns and np.any(np.asarray(Driving.along(route).signs) < 0):
        raise ValueError(
            "tune_route does not support a body with offsets on a route that reverses: use route.window(t0, t1) for "
            "each direction"
        )
    for k, (t, where) in enumerate(((0.0, "start"), (float(np.asarray(route.duration)), "end"))):
        fixed = held[-k, :2].all() if limits.body is not None and limits.body.turns else held[-k, 0]
        if obstacles and fixed:
            found = clearances_at(obstacles, limits.body, route, np.array([t])).items()
            for (name, value), x in zip(found, obstacles, strict=True):
                if k and x.moves:  # the route may end at another time
                    continue
                if float(np.asarray(value)[0]) < 0:  # NaN where the direction of the body is not known
                    raise ValueError(
                        f"at the {where} of the route, which is fixed, the body is inside {name}, by "
                        f"{-float(np.asarray(value)[0]):.4g} m: move the {where}, or free it with fixed="
                    )


def with_obstacles(problem: RouteProblem, own: tuple[Clear, ...], h: np.ndarray) -> RouteProblem:
    """Return the problem with the constraints, whose names the problem contains already.

    Obstacles at rest that no route within the tube reaches are not used. `h` (n,) are the durations of the segments.

    **Raises:** ValueError for obstacles that move and a route that stops before it changes again.
    """
    if not own:
        return problem
    problem = problem._replace(clear=own)
    if any(x.track is not None for x in own):
        _require_one_drive(problem)
        problem = problem._replace(starts=np.cumsum(h) - h)
    used, position = problem.used.copy(), _positions(problem, np.zeros(problem.free.shape))
    width = np.sqrt(problem.fine_tube.sum(axis=0).max(axis=0))
    chord = np.linalg.norm(np.diff(position, axis=1), axis=0).max(axis=0)
    for k, x in enumerate(own):
        if x.track is not None:  # the time at which the vehicle is at a point changes
            continue
        points = np.moveaxis(position, 0, -1)
        distance = np.asarray(x.obstacle.distance(points, np.zeros(points.shape[:-1]))).min(axis=0)
        reach = x.radius + float(np.linalg.norm(x.offset)) + width + chord
        used[len(problem.names) - len(own) + k][:, distance > reach] = False
    own_rows = used[len(problem.names) - len(own) : len(problem.names)].any(axis=1)
    reached = own_rows | np.roll(own_rows, 1, axis=1) | np.roll(own_rows, -1, axis=1)
    return problem._replace(used=used, reached=reached)


def _require_one_drive(problem: RouteProblem) -> None:
    """Raise a ValueError if the times of segments that change depend on more than the times of their own joints."""
    changes = np.flatnonzero(problem.moving)
    stops = changes.size and changes[-1] - changes[0] + 1 > changes.size
    if problem.composed is not None or stops:
        raise ValueError(
            "tune_route does not support obstacles that move on a route with stops in between: use "
            "route.window(t0, t1) for each drive, with obstacles whose polynomials start at t0"
        )


def starts(problem: RouteProblem, own: tuple[Clear, ...]) -> list[np.ndarray]:
    """Return the variables from which searches start: the route itself, or shifted to both sides of obstacles.

    An obstacle that moves may also be passed at another time, after it or before it.
    """
    zero = np.zeros(problem.free.shape)
    hit = _hit(problem, zero, own)
    found = []
    for name in dict.fromkeys(x.name for x in own):
        rows = [k for k, x in enumerate(own) if x.name == name]
        inside = np.asarray(hit[rows].any(axis=(0, 1)))
        if inside.any():
            each = [_shifted(problem, own, rows, inside, side) for side in (1.0, -1.0)]
            if own[rows[0]].track is not None:
                each += retimed.starts(problem, inside, lambda z, rows=rows: not _hit(problem, z, own)[rows].any())
            found.append(each)
    if not found:
        return [zero]
    nearer = [min(each[:2], key=lambda z: float(np.abs(z).max())) for each in found]
    sides = [each if k < BOTH_SIDES else [near] for k, (each, near) in enumerate(zip(found, nearer, strict=True))]
    return [_largest(choice) for choice in itertools.product(*sides)]


def _largest(shifts: Any) -> np.ndarray:
    """Return, for each variable, the shift with the largest magnitude."""
    stack = np.stack(shifts)
    return np.take_along_axis(stack, np.argmax(np.abs(stack), axis=0)[None], axis=0)[0]


def _shifted(
    problem: RouteProblem, own: tuple[Clear, ...], rows: list[int], inside: np.ndarray, side: float
) -> np.ndarray:
    """Return the smallest shift to one side with which no node is inside the obstacle, or the largest in the tube."""
    joints = np.append(inside, False) | np.append(False, inside)
    free = joints & problem.free[:, 1]
    width = np.sqrt(problem.tube[0].max(axis=0))
    of_joints = np.minimum(np.append(width, width[-1]), np.append(width[0], width))
    z = np.zeros(problem.free.shape)
    for part in SHIFTS:
        z[free, 1] = side * part * of_joints[free] / problem.scale[1]
        if not _hit(problem, z, own)[rows].any():
            break
    return z.copy()


def _hit(problem: RouteProblem, z: np.ndarray, own: tuple[Clear, ...]) -> np.ndarray:
    """Return whether a ball enters an obstacle at each node of the segments that may change (clear, nodes, n)."""
    s = segments(problem, z)
    r = derivatives(problem, s.ends)
    position, velocity, at = tuple(r[:3]), tuple(r[3:6]), cleared.times(s)
    return np.stack([np.asarray(x.value(position, velocity, at)) > 1.0 for x in own]) & (problem.moving > 0)


def _positions(problem: RouteProblem, z: np.ndarray) -> np.ndarray:
    """Return the positions (3, nodes, n) of the nodes."""
    rows = basis.table(0, dense=problem.dense)[0]
    ends = segments(problem, z).ends
    return np.einsum("al,lcn->can", rows, ends) + np.asarray(problem.origins)[:, None]


def where_missed(problem: RouteProblem, missed: np.ndarray, times: np.ndarray) -> str:
    """Return where obstacles contradict the tube or other limits: names and intervals of the times [s] of segments."""
    texts = []
    count = len(problem.names) - len(problem.clear)
    for name in dict.fromkeys(x.name for x in problem.clear):
        rows = [count + k for k, x in enumerate(problem.clear) if x.name == name]
        own = np.flatnonzero(missed[rows].any(axis=0))
        if own.size:
            texts.append(f"{name} from t = {times[own[0]]:.4g} to {times[own[-1] + 1]:.4g} s")
    return "; ".join(texts)
