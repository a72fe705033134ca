"""The constraints that balls of the body stay clear of obstacles, at the nodes of a route, with their derivatives.

An obstacle may move. Its constraint then depends on the time of a node, u·h after the start of the segment, so on two
variables: the duration h and the time at the start, that of the first joint of the segment.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.algebra.jets import coordinates
from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.problem import RouteProblem, Segments
from qtraj.foundation.namespace import xp

STATE = 6
"""The number of components of the position and the velocity, on which a clearance depends."""


class Expanded(NamedTuple):
    """Clearances at the nodes with derivatives.

    `slopes` (clear, 6, nodes, n) are those with respect to r and r', `rates` and `clocks` (clear, nodes, n) those with
    respect to the duration and to the time at the start. `path` (6, 6, nodes, n), `mixed` (6, nodes, n) and `twice`
    (nodes, n) are the second derivatives of the weighted sum with respect to r, r' and the duration, and `clock` those
    that contain the time at the start. `clocks` and `clock` are None if no obstacle moves.
    """

    values: Float[np.ndarray, "clear nodes n"]
    slopes: Float[np.ndarray, "clear 6 nodes n"]
    rates: Float[np.ndarray, "clear nodes n"]
    path: Float[np.ndarray, "6 6 nodes n"]
    mixed: Float[np.ndarray, "6 nodes n"]
    twice: Float[np.ndarray, "nodes n"]
    clocks: Any = None
    clock: Any = None


class Clock(NamedTuple):
    """Second derivatives with respect to the time at the start, and to r and r', the duration, or this time again."""

    mixed: Float[np.ndarray, "q nodes n"]
    h: Float[np.ndarray, "nodes n"]
    own: Float[np.ndarray, "nodes n"]


def times(s: Segments, fine: bool = False) -> Any:
    """Return the times (nodes, n) [s] of the nodes, or None if they are not needed."""
    if s.start is None:
        return None
    nodes = basis.FINE_NODES if fine else basis.NODES
    return s.start[None] + nodes[:, None] * s.h[None]


def values(problem: RouteProblem, s: Segments, r: Float[Any, "q nodes n"], fine: bool = False) -> list[Any]:
    """Return the constraints (nodes, n), which are 0 on segments that do not reach the obstacle."""
    found, at = [], times(s, fine)
    for k, clear in enumerate(problem.clear):
        reached = problem.reached[k]
        if not isinstance(reached, np.ndarray) or not isinstance(r, np.ndarray):  # inside a trace
            own = clear.value(*_rows(r), at)
            found.append(xp.where(xp.broadcast_to(reached, own.shape), own, xp.zeros_like(own)))
            continue
        own, on = np.zeros(r.shape[1:]), np.flatnonzero(reached)
        own[:, on] = clear.value(*_rows(r[..., on]), None if at is None else at[:, on])
        found.append(own)
    return found


def _rows(r: Any) -> tuple[Any, Any]:
    return tuple(r[:3]), tuple(r[3:STATE])


def expand(
    problem: RouteProblem,
    s: Segments,
    r: Float[np.ndarray, "q nodes n"],
    weights: Float[np.ndarray, "clear nodes n"],
    stiffness: Float[np.ndarray, "clear nodes n"],
) -> Expanded:
    """Return the constraints and their derivatives, as `constraints.expand` does."""
    count, shape, at = len(problem.clear), r.shape[1:], times(s)
    value, rate, clocks = np.zeros((3, count, *shape))
    slope, second, mixed = np.zeros((count, STATE, *shape)), np.zeros((STATE, STATE, *shape)), np.zeros((STATE, *shape))
    twice, clock = np.zeros(shape), Clock(np.zeros((STATE, *shape)), np.zeros(shape), np.zeros(shape))
    for k, clear in enumerate(problem.clear):
        on = np.flatnonzero(problem.reached[k])
        w, stiff, rows = weights[k][:, on], stiffness[k][:, on], r[:STATE][..., on]
        moves = clear.track is not None
        numbers = coordinates(np.concatenate([rows, at[None][..., on]]) if moves else rows)
        g = clear.value(numbers[:3], numbers[3:STATE], numbers[STATE] if moves else None)
        bent = w * g.hessian + (stiff * g.gradient)[:, None] * g.gradient
        value[k][:, on], slope[k][..., on] = g.value, g.gradient[:STATE]
        second[..., on] += bent[:STATE, :STATE]
        if moves:
            u = basis.NODES[:, None]
            rate[k][:, on], clocks[k][:, on] = u * g.gradient[STATE], g.gradient[STATE]
            across, own = bent[:STATE, STATE], bent[STATE, STATE]
            mixed[..., on] += u * across
            twice[:, on] += u * u * own
            clock.mixed[..., on] += across
            clock.h[:, on] += u * own
            clock.own[:, on] += own
    moving = (clocks, clock) if at is not None else (None, None)
    return Expanded(value, slope, rate, second, mixed, twice, *moving)
