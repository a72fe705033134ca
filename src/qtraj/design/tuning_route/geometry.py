"""Compute the arrays of `RouteProblem` that depend smoothly on a route, its limits and the tube.

The functions accept NumPy arrays and, inside a trace, JAX arrays. `moving` (n,) is 0 for segments that do not change,
and 1 for all others.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning_route import basis
from qtraj.path import pieces

X, Z = np.eye(3)[:1], np.eye(3)[2:]

STRAIGHT = np.zeros((6, 3))
STRAIGHT[[1, 3, 4], 0] = 1.0
"""The scaled end states (see `basis`) of a straight line of length 1, which replaces segments that do not change."""


def joint_states(c: Any, h: Any, still: Any, closed: bool, sense: Any = None) -> Any:
    """Return the states of the joints; `still` (n,) marks the segments that do not change.

    The velocities are those of a vehicle that drives forwards (see `RouteProblem.sense`). The axes of the states
    (n + 1, 3, 3) are the joint, the order of the derivative and the component.

    Where the route jumps, the state of a joint is the mean of the states on both sides. Next to a segment that does not
    change, the state is taken from that segment, so that the tuned route does not jump there. If the route is `closed`,
    the last segment is followed by the first one.
    """
    xp = pieces.arithmetic(c, h)
    first = xp.stack(pieces.values(c, xp.zeros_like(h), 2), axis=1)
    last = xp.stack(pieces.values(c, h, 2), axis=1)
    if sense is not None:
        turned = sense[:, None, None] ** np.arange(3.0)[:, None]
        first, last = first * turned, last * turned
    weight = 0.5 * (1.0 + still - xp.roll(still, 1))[:, None, None]
    states = weight * first + (1.0 - weight) * xp.roll(last, 1, axis=0)
    ends = (states[:1], states[:1]) if closed else (first[:1], last[-1:])
    return xp.concatenate([ends[0], states[1:], ends[1]])


def same_terms(one: Any, other: Any) -> tuple[Any, Any]:
    """Pad two arrays of coefficients (n, terms, 3) with zeros to the same number of terms."""
    terms = max(one.shape[1], other.shape[1])
    xp = pieces.arithmetic(one, other)
    first, second = (xp.pad(c, [(0, 0), (0, terms - c.shape[1]), (0, 0)]) for c in (one, other))
    return first, second


def smooth_fields(
    c: Any, h: Any, states: Any, tube: Any, moving: Any, composed: Any = None, sense: Any = None
) -> dict[str, Any]:
    """Return the fields of a `RouteProblem` that depend smoothly on the route and the tube, except the objective."""
    places = basis.places(composed, moving.shape[0])
    return {
        "ends": ends(states, h, moving, sense),
        "durations": pieces.arithmetic(h).where(moving > 0, h, 1.0),
        "offset": offsets(c, h, states, moving, places, sense),
        "tube": tube_squares(tube, places),
        "axes": axes(states),
    }


def ends(states: Any, h: Any, moving: Any, sense: Any = None) -> Any:
    """Return the scaled end states (see `basis`); segments that do not change become straight lines of length 1.

    The axes of the result (6, 3, n) are the index of the scaled end state, the component and the segment.
    """
    xp = pieces.arithmetic(states, h)
    start, end = states[:-1], states[1:]
    known = xp.concatenate([xp.zeros_like(start[:, :1]), start[:, 1:], end[:, :1] - start[:, :1], end[:, 1:]], axis=1)
    signed = h if sense is None else h * sense
    known = known * (signed[:, None] ** np.array([basis.POWERS], float))[:, :, None]
    return xp.moveaxis(xp.where(moving[:, None, None] > 0, known, STRAIGHT[None]), 0, -1)


def time_scale(durations: Any, moving: Any) -> Any:
    """Return the mean duration [s] of the segments that change; without such segments, 1."""
    xp, count = pieces.arithmetic(durations, moving), moving.sum()
    return xp.where(count > 0, xp.sum(durations * moving) / xp.maximum(count, 1.0), 1.0)


def nearest(end_data: Any, durations: Any, moving: Any, length: Any) -> tuple[Any, Any]:
    """Return the weights `near` (6, 6, n) and `pace` (n,) of the objective "nearest", in units of `length` [m]."""
    xp, time = pieces.arithmetic(end_data, durations), time_scale(durations, moving)
    own, near = durations * moving / time, 0.0
    for k in range(3):
        weight = own * (time / durations) ** (2.0 * k) / length**2
        near = near + basis.gram(k)[:, :, None] * weight[None, None]
    speed = speeds(end_data, durations)
    return near, own * time**2 * xp.maximum(speed, 1e-3 * xp.max(speed)) ** 2 / length**2


def speeds(end_data: Any, durations: Any) -> Any:
    """Return the RMS speeds (n,) [m/s]."""
    xp = pieces.arithmetic(end_data, durations)
    return xp.sqrt(xp.einsum("lm,lcn,mcn->n", basis.gram(1), end_data, end_data)) / durations


def axes(states: Any) -> Any:
    """Return unit vectors along, to the left of and above the path at the joints.

    The axes of the result (n + 1, 3, 3) are the joint, the unit vector and the component.
    """
    xp, v = pieces.arithmetic(states), states[:, 1]
    v = xp.where(xp.sum(v * v, axis=1)[:, None] == 0, X, v)
    along = v / xp.linalg.norm(v, axis=1)[:, None]
    steep = xp.abs(along[:, 2]) > 0.9
    left = xp.cross(xp.where(steep[:, None], X, Z), along)
    left = left / xp.linalg.norm(left, axis=1)[:, None]
    return xp.stack([along, left, xp.cross(along, left)], axis=1)


def offsets(c: Any, h: Any, states: Any, moving: Any, nodes: Float[np.ndarray, "nodes n"], sense: Any = None) -> Any:
    """Return the quintics through the states minus the original path; axes (3, nodes, n): component, node, segment."""
    own, c = same_terms(pieces.hermite(h, states, sense), c)
    xp = pieces.arithmetic(own, c)
    exponents = np.arange(own.shape[1], dtype=float)[None]
    # Separate powers, because the derivative of 0⁰ with respect to its base would be NaN.
    rows = (own - c) * (h[:, None] ** exponents)[:, :, None]
    rows = xp.einsum("fnk,nkc->cfn", nodes[..., None] ** exponents, rows)
    return rows * moving[None, None]


def tube_squares(tube: Any, nodes: Float[np.ndarray, "nodes n"]) -> Any:
    """Return the squares of the horizontal and vertical half-widths (2, nodes, n).

    The half-widths are linear between the joints.
    """
    nodes = nodes.T[:, None]
    widths = tube[:-1, :, None] * (1 - nodes) + tube[1:, :, None] * nodes
    return pieces.arithmetic(tube).moveaxis(widths**2, 0, -1)


def moved_states(problem: Any, states: Any, h: Any, z: Any) -> tuple[Any, Any]:
    """Return the states of the joints and the durations (n,) for the variables `z`.

    The axes of the states (n + 1, 3, 3) are the joint, the order of the derivative and the component.
    """
    xp = pieces.arithmetic(z, states, h, problem.axes)
    scale, axes, per_time = (xp.asarray(x) for x in (problem.scale, problem.axes, problem.per_time))
    move = z * scale[None]
    return states + xp.matmul(move[:, :9].reshape(-1, 3, 3), axes), h + per_time * xp.diff(move[:, 9])


def changed(problem: Any, c: Any, h: Any, states: Any, z: Any) -> tuple[Any, Any]:
    """Return coefficients and durations for the variables `z`; segments that do not change keep their coefficients."""
    new_states, new_h = moved_states(problem, states, h, z)
    new, old = same_terms(pieces.hermite(new_h, new_states, problem.sense), c)
    xp = pieces.arithmetic(new, old)
    return xp.where(xp.asarray(problem.moving)[:, None, None] > 0, new, old), new_h
