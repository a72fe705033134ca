"""Compute first and second derivatives of the objective and the constraints with respect to the joint variables.

Products with constant matrices turn derivatives at the nodes into derivatives with respect to the scaled states
y = (p, hv, h²a) at both ends of a segment (see `basis`). The chain rule for y gives the derivatives with respect to the
states and times of the segment's joints, in world axes. A matrix for each joint converts them to the variables.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.solve.chain import Border, Chain
from qtraj.design.tuning_route import basis, circuit
from qtraj.design.tuning_route.cleared import Clock
from qtraj.design.tuning_route.constraints import Curvature, Expansion
from qtraj.design.tuning_route.problem import BLOCK, RouteProblem, Segments, bent, factors, off_target, squared_jerk

_POWERS = np.array(basis.POWERS, float)[:, None, None]


class Local(NamedTuple):
    """First derivatives of a sum over segments with respect to the scaled end states and the durations.

    The axes of `ends` (6, 3, n) are the index of the scaled end state (see `basis`), the component and the segment.
    """

    ends: Float[np.ndarray, "6 3 n"]
    h: Float[np.ndarray, " n"]
    start: Any = None


class LocalSecond(NamedTuple):
    """Second derivatives of a sum over segments with respect to the scaled end states (see `basis`) and the durations.

    The axes of `ends` (6, 6, 3, 3, n) are two indices of scaled end states, two components and the segment. `mixed`
    (6, 3, n) are derivatives with respect to a scaled end state and the duration, and `h` with respect to the duration.
    `start` are those that contain the times at the starts; None if no obstacle moves.
    """

    ends: Float[np.ndarray, "6 6 3 3 n"]
    mixed: Float[np.ndarray, "6 3 n"]
    h: Float[np.ndarray, " n"]
    start: Clock | None = None


def objective_first(problem: RouteProblem, s: Segments) -> Local:
    """Compute first derivatives of the objective."""
    near = 2 * np.einsum("lmn,mcn->lcn", problem.near, off_target(problem, s))
    pace = 2 * problem.pace * (s.h / problem.durations - 1.0) / problem.durations
    rough = -5 * problem.jerk * s.h**-6 * squared_jerk(s)
    return Local(near + 2 * problem.jerk * s.h**-5 * bent(s), pace + rough + problem.time)


def objective_second(problem: RouteProblem, s: Segments) -> LocalSecond:
    """Compute second derivatives of the objective."""
    own = 2 * (problem.near + problem.jerk * s.h**-5 * basis.gram(3)[:, :, None])
    rough = 30 * problem.jerk * s.h**-7 * squared_jerk(s)
    return LocalSecond(
        own[:, :, None, None] * np.eye(3)[:, :, None],
        -10 * problem.jerk * s.h**-6 * bent(s),
        rough + 2 * problem.pace / problem.durations**2,
    )


def constraints_first(
    problem: RouteProblem,
    s: Segments,
    at: Expansion,
    weights: Float[np.ndarray, "constraints nodes n"],
    of_bounds: Float[np.ndarray, "2 n"],
) -> Local:
    """Compute first derivatives of the weighted sum of the constraints."""
    low, high = of_bounds
    tube = 2 * at.away * (weights[-2:] / problem.tube)[[0, 0, 1]]
    table = basis.table(0, dense=problem.dense)[0]
    ends = _pulled(at.slopes, weights[:-2], problem) + _combined(table, tube)
    h = np.sum(weights[:-2] * at.rates, axis=(0, 1))
    start = None if at.clocks is None else np.sum(weights[-2 - len(at.clocks) : -2] * at.clocks, axis=(0, 1))
    return Local(ends, h - low / problem.shortest + high / problem.longest, start)


def constraints_second(
    problem: RouteProblem,
    at: Expansion,
    curvature: Curvature,
    weights: Float[np.ndarray, "constraints nodes n"],
    stiffness: Float[np.ndarray, "constraints nodes n"],
    of_bounds: Float[np.ndarray, "2 n"],
) -> LocalSecond:
    """Compute Σ weight·(second derivatives) + stiffness·gradient·gradientᵀ of the constraints.

    `curvature` is the second result of `expand`, and `of_bounds` the stiffness of the bounds on the durations.
    """
    order, (nodes, n) = len(curvature.path) // 3, at.away.shape[1:]
    inner = curvature.path.reshape(order, 3, order, 3, nodes, n).transpose(0, 2, 4, 1, 3, 5).reshape(-1, 9 * n)
    ends = basis.products(order, problem.first, problem.dense) @ inner
    ends += basis.squares(problem.dense) @ _tube_second(problem, at.away, weights[-2:], stiffness[-2:]).reshape(
        -1, 9 * n
    )
    low, high = of_bounds
    h = np.sum(curvature.h, axis=0) + low / problem.shortest**2 + high / problem.longest**2
    own, start = curvature.clock, None
    if own is not None:
        mixed = np.zeros(curvature.mixed.shape)
        mixed[: len(own.mixed)] = own.mixed
        start = Clock(_of_ends(mixed, problem), np.sum(own.h, axis=0), np.sum(own.own, axis=0))
    return LocalSecond(ends.reshape(6, 6, 3, 3, n), _of_ends(curvature.mixed, problem), h, start)


def pushed(
    problem: RouteProblem, at: Expansion, change: Segments
) -> tuple[Float[np.ndarray, "constraints nodes n"], Float[np.ndarray, "2 n"]]:
    """Return the changes of the constraints at the nodes and of the bounds, for the change of the segments."""
    limits, q, nodes, n = at.slopes.shape
    rows = basis.rows(q // 3, problem.first, dense=problem.dense)
    r = (rows.reshape(-1, 6) @ change.ends.reshape(6, -1)).reshape(q // 3, nodes, 3, n)
    found = np.einsum("pkcan,kacn->pan", at.slopes.reshape(limits, q // 3, 3, nodes, n), r)
    found += change.h * at.rates
    if at.clocks is not None:
        found[limits - len(at.clocks) :] += change.start * at.clocks
    flat = basis.table(0, dense=problem.dense)[0] @ change.ends.reshape(6, -1)
    shift = np.moveaxis(flat.reshape(nodes, 3, n), 1, 0)
    away = 2 * at.away * shift
    tube = np.stack([away[0] + away[1], away[2]]) / problem.tube
    return np.concatenate([found, tube]), np.stack([-change.h / problem.shortest, change.h / problem.longest])


def changed_ends(
    problem: RouteProblem, s: Segments, states: Float[np.ndarray, "6 3 n"], dh: Float[np.ndarray, " n"], later: Any
) -> Segments:
    """Return the changes of the segments for changes of states at their ends, durations and starts."""
    ends = factors(problem, s.h) * states + _POWERS * s.ends * (dh / s.h)
    return Segments(dh, ends, ends, later)


def _pulled(
    slopes: Float[np.ndarray, "limits q nodes n"], weights: Float[np.ndarray, "limits nodes n"], problem: RouteProblem
) -> Float[np.ndarray, "6 3 n"]:
    """Return the derivatives of a weighted sum of the limits with respect to the scaled end states."""
    return _of_ends(np.einsum("pqan,pan->qan", slopes, weights), problem)


def _of_ends(at: Float[np.ndarray, "q nodes n"], problem: RouteProblem) -> Float[np.ndarray, "6 3 n"]:
    """Return derivatives with respect to the scaled end states, from those with respect to derivatives at the nodes."""
    q, nodes, n = at.shape
    at = at.reshape(q // 3, 3, nodes, n)
    rows = basis.rows(q // 3, problem.first, dense=problem.dense)
    return _combined(rows.reshape(-1, 6), at.swapaxes(0, 1).reshape(3, -1, n))


def _combined(rows: Float[np.ndarray, "k 6"], at: Float[np.ndarray, "3 k n"]) -> Float[np.ndarray, "6 3 n"]:
    return (rows.T @ at.swapaxes(0, 1).reshape(len(rows), -1)).reshape(6, 3, -1)


def _tube_second(
    problem: RouteProblem,
    away: Float[np.ndarray, "3 nodes n"],
    weights: Float[np.ndarray, "2 nodes n"],
    stiffness: Float[np.ndarray, "2 nodes n"],
) -> Float[np.ndarray, "nodes 3 3 n"]:
    """Return the second derivatives of the tube's constraints with respect to the displacements."""
    found = np.zeros((away.shape[1], 3, 3, away.shape[2]))
    for k, own in enumerate(([0, 1], [2])):
        steep = 4 * stiffness[k] / problem.tube[k] ** 2
        for i in own:
            found[:, i, i] = 2 * weights[k] / problem.tube[k]
            for j in own:
                found[:, i, j] += steep * away[i] * away[j]
    return found


def frames(problem: RouteProblem) -> Float[np.ndarray, "joints 10 10"]:
    """Return the matrices that convert variables to changes of states [SI, world axes] and of times [s].

    The columns of fixed variables are zero.
    """
    found = np.zeros((*problem.free.shape, BLOCK))
    for k in range(0, 9, 3):
        found[:, k : k + 3, k : k + 3] = problem.axes.swapaxes(1, 2)
    found[:, 9, 9] = 1.0
    return found * (problem.scale * problem.free)[:, None]


def gradient(problem: RouteProblem, turns: Float[np.ndarray, "joints 10 10"], s: Segments, first: Local) -> np.ndarray:
    """Return the derivatives (joints, 10) with respect to the variables; `turns` are the `frames`."""
    states = np.moveaxis(first.ends * factors(problem, s.h), -1, 0).reshape(-1, 2, 9)
    h = first.h + np.sum(_POWERS * s.ends * first.ends, axis=(0, 1)) / s.h
    total = np.zeros((len(turns), BLOCK))
    for k, (joints, sign) in enumerate(((np.s_[:-1], -1), (np.s_[1:], 1))):
        total[joints, :9] += states[:, k]
        total[joints, 9] += sign * h * _per_time(problem)
    if first.start is not None:
        total[:-1, 9] += first.start
    return np.einsum("nij,ni->nj", turns, circuit.gathered(problem, total))


def hessian(
    problem: RouteProblem, turns: Float[np.ndarray, "joints 10 10"], rows: Float[np.ndarray, "n 2 10 2 10"]
) -> Chain:
    """Return the second derivatives; the rows of fixed variables are rows of the identity matrix.

    `turns` are the `frames`, and `rows` the results of `segment_hessian`.
    """
    diagonal = np.zeros_like(turns)
    diagonal[:-1] += rows[:, 0, :, 0]
    diagonal[1:] += rows[:, 1, :, 1]
    lower, back = rows[:, 1, :, 0], turns.swapaxes(1, 2)
    unit = np.eye(BLOCK) * ~problem.free[:, None]
    if problem.seam is None:
        return Chain(back @ diagonal @ turns + unit, back[1:] @ lower @ turns[:-1])
    corner, side = circuit.border(diagonal, lower)
    border = Border(back[0] @ corner @ turns[0] + unit[0], back @ side @ turns[0])
    turns, unit = turns.copy(), unit.copy()  # the border contains the first joint
    turns[0], unit[0] = 0.0, np.eye(BLOCK)
    back = turns.swapaxes(1, 2)
    return Chain(back @ diagonal @ turns + unit, back[1:] @ lower @ turns[:-1], border)


def _per_time(problem: RouteProblem) -> Float[np.ndarray, " n"]:
    """Return the change of the durations for a change of the time, of the segments that may change."""
    return np.where(problem.per_time > 0, problem.per_time, 1.0)


def segment_hessian(
    problem: RouteProblem, s: Segments, first: Local, second: LocalSecond
) -> Float[np.ndarray, "n 2 10 2 10"]:
    """Convert second derivatives to those with respect to the states and times of both joints, in world axes."""
    n = len(s.h)
    factor, grown = factors(problem, s.h), _POWERS * s.ends / s.h
    turned = np.einsum("lmcdn,mdn->lcn", second.ends, grown)
    mixed = factor * (second.mixed + turned) + _POWERS * factor / s.h * first.ends
    h = second.h + np.sum(
        grown * (2 * second.mixed + turned) + _POWERS * (_POWERS - 1) * s.ends / s.h**2 * first.ends, axis=(0, 1)
    )
    states = second.ends * (factor * factor[:, 0])[:, :, None, None]
    states = states.transpose(4, 0, 2, 1, 3).reshape(n, 2, 9, 2, 9)
    mixed = np.moveaxis(mixed, -1, 0).reshape(n, 2, 9)
    mixed, h = mixed * _per_time(problem)[:, None, None], h * _per_time(problem) ** 2
    sign = np.array([-1.0, 1.0])
    found = np.empty((n, 2, BLOCK, 2, BLOCK))
    found[:, :, :9, :, :9] = states
    found[:, :, :9, :, 9] = mixed[:, :, :, None] * sign
    found[:, :, 9, :, :9] = sign[:, None, None] * mixed[:, None]
    found[:, :, 9, :, 9] = np.multiply.outer(h, np.outer(sign, sign))
    if second.start is not None:
        _add_starts(found, second.start, factor, grown)
    return found


def _add_starts(
    rows: Float[np.ndarray, "n 2 10 2 10"],
    own: Clock,
    factor: Float[np.ndarray, "6 1 n"],
    grown: Float[np.ndarray, "6 3 n"],
) -> None:
    """Add the second derivatives that contain the time at the start, which is that of the first joint."""
    states = np.moveaxis(factor * own.mixed, -1, 0).reshape(len(rows), 2, 9)
    h = own.h + np.sum(grown * own.mixed, axis=(0, 1))
    rows[:, :, :9, 0, 9] += states
    rows[:, 0, 9, :, :9] += states
    rows[:, 0, 9, 0, 9] += own.own - 2 * h
    rows[:, 0, 9, 1, 9] += h
    rows[:, 1, 9, 0, 9] += h
