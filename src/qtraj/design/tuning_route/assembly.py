"""Compute first and second derivatives of the objective and the constraints with respect to the joint variables.

Products with constant matrices turn derivatives at the nodes into derivatives with respect to the scaled states
y = (p, hv, h²a) at both ends of a segment (see `basis`). The chain rule for y then gives the derivatives with respect
to the states and times of the segment's joints.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.tuning_route import basis, circuit
from qtraj.design.tuning_route.basis import lifted
from qtraj.design.tuning_route.chain import Chain
from qtraj.design.tuning_route.constraints import Expansion
from qtraj.design.tuning_route.problem import BLOCK, JERK, RouteProblem, Segments, powers

_POWERS = np.array(basis.POWERS, float)


class Local(NamedTuple):
    """First derivatives of a sum over segments with respect to the scaled end states and the durations.

    The axes of `ends` (6, 3, n) are the index of the scaled end state (see `basis`), the component and the segment.
    """

    ends: Float[Array, "6 3 n"]
    h: Float[Array, " n"]


class LocalSecond(NamedTuple):
    """Second derivatives of a sum over segments with respect to the scaled end states (see `basis`) and the durations.

    The axes of `ends` (6, 6, 3, 3, n) are two indices of scaled end states, two components and the segment. `mixed`
    (6, 3, n) are derivatives with respect to a scaled end state and the duration, and `h` with respect to the duration.
    """

    ends: Float[Array, "6 6 3 3 n"]
    mixed: Float[Array, "6 3 n"]
    h: Float[Array, " n"]


def objective_first(problem: RouteProblem, s: Segments) -> Local:
    """Compute first derivatives of the objective."""
    bent: Array = jnp.einsum("lm,mcn->lcn", JERK, s.ends)
    near = 2 * jnp.sum(problem.near[:, :, None] * s.change[None], axis=1)
    pace = 2 * problem.pace * (s.h / problem.durations - 1.0) / problem.durations
    rough = -5 * problem.jerk * s.h**-6 * jnp.sum(bent * s.ends, axis=(0, 1))
    return Local(near + lifted(2 * problem.jerk * s.h**-5, 3) * bent, pace + rough + problem.time)


def objective_second(problem: RouteProblem, s: Segments) -> LocalSecond:
    """Compute second derivatives of the objective."""
    bent: Array = jnp.einsum("lm,mcn->lcn", JERK, s.ends)
    own = 2 * (problem.near + lifted(problem.jerk * s.h**-5, 3) * JERK[:, :, None])
    rough = 30 * problem.jerk * s.h**-7 * jnp.sum(bent * s.ends, axis=(0, 1))
    return LocalSecond(
        own[:, :, None, None] * np.eye(3)[None, None, :, :, None],
        lifted(-10 * problem.jerk * s.h**-6, 3) * bent,
        rough + 2 * problem.pace / problem.durations**2,
    )


def _table(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Hermite functions H_l (see `basis`) at the nodes, (nodes, 6), and their derivatives.

    The derivatives (order, nodes, 6) have the orders 1 to `order`.
    """
    rows = basis.at_nodes(basis.NODES, order)
    return rows[0], rows[1:]


def constraints_first(
    problem: RouteProblem,
    slopes: Float[Array, "q limits nodes n"],
    away: Float[Array, "3 nodes n"],
    weights: Float[Array, "constraints nodes n"],
) -> Local:
    """Compute first derivatives of the weighted sum of the constraints, from derivatives at the nodes (`Expansion`)."""
    order, n = (slopes.shape[0] - 1) // 3, away.shape[-1]
    place, table = _table(order)
    slopes = jnp.sum(slopes * weights[None, :-2], axis=1)
    rows = jnp.moveaxis(slopes[:-1].reshape(order, 3, -1, n), 1, 2).reshape(-1, 3 * n)
    near = weights[-2:] / problem.tube
    weighted = 2 * away * jnp.stack([near[0], near[0], near[1]])
    away = jnp.moveaxis(weighted, 0, 1).reshape(-1, 3 * n)
    ends = jnp.matmul(table.reshape(-1, 6).T, rows) + jnp.matmul(place.T, away)
    return Local(ends.reshape(6, 3, n), jnp.sum(slopes[-1], axis=0))


def constraints_second(
    problem: RouteProblem,
    at: Expansion,
    weights: Float[Array, "constraints nodes n"],
    stiffness: Float[Array, "constraints nodes n"],
) -> LocalSecond:
    """Return Σ (weight·∇²g + stiffness·∇g∇gᵀ) over all constraints g.

    `at` contains the weighted second derivatives of the limits.
    """
    order, n = (at.slopes.shape[0] - 1) // 3, at.away.shape[-1]
    place, table = _table(order)
    stiff = stiffness[:-2]
    whole = at.bending + jnp.sum(at.slopes[:, None] * (at.slopes * stiff[None])[None], axis=2)
    inner = whole[:-1, :-1].reshape(order, 3, order, 3, -1, n)
    inner = jnp.transpose(inner, (0, 2, 4, 1, 3, 5)).reshape(-1, 9 * n)
    pairs = np.einsum("ajl,bjm->lmabj", table, table).reshape(36, -1)
    near = jnp.stack([weights[-2], weights[-2], weights[-1]]) / jnp.stack([problem.tube[0]] * 2 + [problem.tube[1]])
    steep = stiffness[-2:] / problem.tube**2
    level, up = steep[0], steep[1]
    x, y, z = at.away
    zero = jnp.zeros_like(x)
    own = [
        [2 * near[0] + 4 * level * x * x, 4 * level * x * y, zero],
        [4 * level * x * y, 2 * near[1] + 4 * level * y * y, zero],
        [zero, zero, 2 * near[2] + 4 * up * z * z],
    ]
    tube = jnp.stack([jnp.stack(row, axis=1) for row in own], axis=1).reshape(-1, 9 * n)
    squares = np.einsum("jl,jm->lmj", place, place).reshape(36, -1)
    ends = pairs @ inner + squares @ tube
    cross = jnp.moveaxis(whole[:-1, -1].reshape(order, 3, -1, n), 1, 2).reshape(-1, 3 * n)
    mixed = jnp.matmul(table.reshape(-1, 6).T, cross).reshape(6, 3, n)
    return LocalSecond(ends.reshape(6, 6, 3, 3, n), mixed, jnp.sum(whole[-1, -1], axis=0))


def segment_gradient(problem: RouteProblem, s: Segments, first: Local) -> Float[Array, "20 n"]:
    """Convert first derivatives to derivatives with respect to the variables of both joints of each segment."""
    power = _POWERS[:, None, None]
    grown = power * s.ends / lifted(s.h, 3)
    states = (first.ends * powers(s.h)).reshape(2, 3, 1, 3, -1)
    states = jnp.sum(states * problem.axes[:, None], axis=3)
    h = (first.h + jnp.sum(grown * first.ends, axis=(0, 1))) * problem.moving
    parts = [states[0].reshape(9, -1), -h[None], states[1].reshape(9, -1), h[None]]
    return jnp.concatenate(parts) * jnp.concatenate([problem.scale] * 2)[:, None]


def segment_hessian(problem: RouteProblem, s: Segments, first: Local, second: LocalSecond) -> Float[Array, "20 20 n"]:
    """Convert second derivatives to derivatives with respect to the variables of both joints of each segment."""
    n = s.h.shape[0]
    power = _POWERS[:, None, None]
    duration = lifted(s.h, 3)
    factor = powers(s.h)[:, 0]
    grown = power * s.ends / duration
    curved = power * (power - 1) * s.ends / duration**2
    turned = jnp.sum(second.ends * grown[None, :, None], axis=(1, 3))
    states = second.ends * (factor[:, None] * factor[None])[:, :, None, None]
    mixed = factor[:, None] * (second.mixed + turned) + (power * powers(s.h) / duration) * first.ends
    h = second.h + jnp.sum(grown * (2 * second.mixed + turned) + curved * first.ends, axis=(0, 1))
    axes = problem.axes
    states = states.reshape(2, 3, 2, 3, 1, 3, 3, n)  # side, order, side, order, component, component
    states = jnp.sum(states * axes[:, None, None, None, :, :, None], axis=5)
    states = jnp.sum(states[:, :, :, :, :, None] * axes[None, None, :, None, None], axis=6)
    states = jnp.transpose(states, (0, 1, 4, 2, 3, 5, 6)).reshape(2, 9, 2, 9, n)
    mixed = jnp.sum(mixed.reshape(2, 3, 1, 3, n) * axes[:, None], axis=3).reshape(2, 9, n) * lifted(problem.moving, 3)
    h = h * problem.moving
    sign = (-1.0, 1.0)

    def block(a: int, b: int) -> Array:
        top = jnp.concatenate([states[a, :, b], sign[b] * mixed[a][:, None]], axis=1)
        last = jnp.concatenate([sign[a] * mixed[b], sign[a] * sign[b] * h[None]])
        return jnp.concatenate([top, last[None]])

    whole = jnp.concatenate([jnp.concatenate([block(a, b) for b in range(2)], axis=1) for a in range(2)])
    scale = jnp.concatenate([problem.scale] * 2)
    return whole * (scale[:, None] * scale[None])[:, :, None]


def gradient(problem: RouteProblem, rows: Float[Array, "20 n"]) -> Float[Array, "10 joints"]:
    """Sum the gradients of the segments; the entries of fixed variables are zero."""
    total = jnp.pad(rows[:BLOCK], ((0, 0), (0, 1))) + jnp.pad(rows[BLOCK:], ((0, 0), (1, 0)))
    return circuit.gathered(problem, total)


def hessian(problem: RouteProblem, rows: Float[Array, "20 20 n"]) -> Chain:
    """Sum the second derivatives of the segments; the rows of fixed variables are rows of the identity matrix."""
    blocks, free = jnp.moveaxis(rows, -1, 0), problem.free.T
    first, last = blocks[:, :BLOCK, :BLOCK], blocks[:, BLOCK:, BLOCK:]
    diagonal = jnp.pad(first, ((0, 1), (0, 0), (0, 0))) + jnp.pad(last, ((1, 0), (0, 0), (0, 0)))
    lower = blocks[:, BLOCK:, :BLOCK]
    if problem.seam is not None:
        return circuit.bordered(free, problem.seam, diagonal, lower)
    diagonal = diagonal * free[:, :, None] * free[:, None] + (1 - free)[:, :, None] * np.eye(BLOCK)[None]
    return Chain(diagonal, lower * free[1:, :, None] * free[:-1, None])
