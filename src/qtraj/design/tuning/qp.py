"""Solve batches of small convex quadratic programs by an interior-point method (Mehrotra's predictor–corrector).

A program has the variables d and t, the allowed violation:

    minimise ½dᵀHd + gᵀd + νt + ½εt²   subject to   a·d + c ≤ t for each constraint,   low ≤ d ≤ high,   t ≥ t_min.

All arrays have the batch axis last, and every operation treats the whole batch. Solved programs leave the batch.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

MAX_STEPS = 30

CENTRAL = 0.3
"""Below this length of the predictor, a step moves to a more central point with this part of the mean product."""

TO_BOUNDARY = 0.995
"""Fraction of the longest step that keeps slacks and multipliers positive."""


class QP(NamedTuple):
    """A batch of quadratic programs; see the module."""

    hessian: Float[np.ndarray, "n n batch"]
    gradient: Float[np.ndarray, "n batch"]
    normals: Float[np.ndarray, "k n batch"]
    values: Float[np.ndarray, "k batch"]
    low: Float[np.ndarray, "n batch"]
    high: Float[np.ndarray, "n batch"]
    penalty: Float[np.ndarray, " batch"]
    stiffness: Float[np.ndarray, " batch"]
    lowest: Float[np.ndarray, " batch"]
    tolerance: Float[np.ndarray, " batch"]  # the mean product of slacks and multipliers at which a program is solved

    def take(self, index: np.ndarray) -> "QP":
        """Return some of the programs."""
        return QP(*(x[..., index] for x in self))


class _State(NamedTuple):
    """The variables x = (d, t), and the multipliers of all inequalities: constraints, upper and lower bounds."""

    x: Float[np.ndarray, "n+1 batch"]
    multipliers: Float[np.ndarray, "m batch"]


def minimise(qp: QP) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the steps d (n, batch), the allowed violations t, and the multipliers of the constraints (k, batch)."""
    n, count = qp.gradient.shape
    k = len(qp.values)
    x, multipliers = np.zeros((n + 1, count)), np.zeros((k, count))
    rest, state = np.arange(count), _start(qp)
    last = state
    for step in range(MAX_STEPS):
        slack = _slacks(qp, state.x)
        mean = (slack * state.multipliers).mean(axis=0)
        lost = np.isnan(mean)
        if lost.any():  # the last step was beyond the rounding error of its program
            state = _State(*(np.where(lost, x, y) for x, y in zip(last, state, strict=True)))
        done = ~(mean > qp.tolerance) | (step == MAX_STEPS - 1)
        if done.any():
            x[:, rest[done]], multipliers[:, rest[done]] = state.x[:, done], state.multipliers[:k, done]
            if done.all():
                break
            rest, qp, slack, mean = rest[~done], qp.take(~done), slack[:, ~done], mean[~done]
            state = _State(state.x[:, ~done], state.multipliers[:, ~done])
        last, state = state, _step(qp, state, slack, mean)
    return x[:n], x[n], multipliers


def _start(qp: QP) -> _State:
    n, count = qp.gradient.shape
    k = len(qp.values)
    width = qp.high - qp.low
    d = np.clip(0.0, qp.low + 0.1 * width, qp.high - 0.1 * width)
    at = np.einsum("kib,ib->kb", qp.normals, d) + qp.values
    t = np.maximum(at.max(axis=0, initial=-np.inf), qp.lowest) + 1.0
    x = np.concatenate([d, t[None]])
    multipliers = np.ones((k + 2 * n + 1, count))
    multipliers[:k] = multipliers[-1] = qp.penalty / (k + 1)  # these balance the penalty
    return _State(x, multipliers)


def _slacks(qp: QP, x: np.ndarray) -> np.ndarray:
    """Return the slacks of the constraints, the bounds on d, and the bound on t."""
    d, t = x[:-1], x[-1]
    at = np.einsum("kib,ib->kb", qp.normals, d) + qp.values
    return np.concatenate([t - at, qp.high - d, d - qp.low, (t - qp.lowest)[None]])


def _step(qp: QP, state: _State, slack: np.ndarray, mean: np.ndarray) -> _State:
    x, multipliers = state
    n, k = len(x) - 1, len(qp.values)
    weight = multipliers / slack
    matrix = np.empty((n + 1, n + 1, mean.size))
    weighted = qp.normals * weight[:k, None]
    matrix[:n, :n] = qp.hessian + np.einsum("kib,kjb->ijb", weighted, qp.normals)
    matrix[range(n), range(n)] += weight[k : k + n] + weight[k + n : k + 2 * n]
    matrix[n, :n] = matrix[:n, n] = -weighted.sum(axis=0)
    matrix[n, n] = qp.stiffness + weight[:k].sum(axis=0) + weight[-1]
    inverse = inverse_factor(matrix)
    base = np.empty_like(x)
    base[:n] = -np.einsum("ijb,jb->ib", qp.hessian, x[:n]) - qp.gradient
    base[n] = -qp.penalty - qp.stiffness * x[n]
    step = solve(inverse, base)
    moved = _along(qp, step)
    # The slacks change by −moved; the products of slacks and multipliers go to zero.
    change = -multipliers + weight * moved
    length = _longest(slack, -moved, multipliers, change)
    after = ((slack - length * moved) * (multipliers + length * change)).mean(axis=0)
    # A short step means that some products are far below the mean: the next point must be more central.
    central = length < CENTRAL
    target = np.where(central, CENTRAL, (after / mean) ** 3) * mean
    corrected = (target + np.where(central, 0.0, moved * change)) / slack  # the product of changes is −moved·change
    step = solve(inverse, base - _back(qp, corrected))
    moved = _along(qp, step)
    change = -multipliers + corrected + weight * moved
    length = TO_BOUNDARY * _longest(slack, -moved, multipliers, change)
    return _State(x + length * step, multipliers + length * change)


def _along(qp: QP, step: np.ndarray) -> np.ndarray:
    """Return the changes of the left-hand sides of all inequalities for a step."""
    d, t = step[:-1], step[-1]
    return np.concatenate([np.einsum("kib,ib->kb", qp.normals, d) - t, d, -d, -t[None]])


def _back(qp: QP, y: np.ndarray) -> np.ndarray:
    """Return the sum of the normals of all inequalities, weighted by `y`."""
    n, k = len(qp.gradient), len(qp.values)
    d = np.einsum("kib,kb->ib", qp.normals, y[:k]) + y[k : k + n] - y[k + n : k + 2 * n]
    return np.concatenate([d, -(y[:k].sum(axis=0) + y[-1])[None]])


def _longest(slack: np.ndarray, slack_change: np.ndarray, multipliers: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return the longest step, at most 1, that keeps slacks and multipliers nonnegative."""
    fastest = np.maximum((-slack_change / slack).max(axis=0), (-change / multipliers).max(axis=0))
    return 1 / np.maximum(fastest, 1.0)


def cholesky(matrix: Float[np.ndarray, "n n batch"]) -> tuple[np.ndarray, np.ndarray]:
    """Return factors L of L Lᵀ (with the inverses of the diagonal elements in place of these), and the least pivots."""
    a = np.array(matrix)
    n = len(a)
    least = np.full(a.shape[2:], np.inf)
    for k in range(n):
        pivot = a[k, k]
        np.minimum(least, pivot, out=least)
        inverse = 1 / np.sqrt(np.maximum(pivot, 1e-300))
        a[k, k] = inverse
        if k + 1 < n:
            column = a[k + 1 :, k]
            column *= inverse
            a[k + 1 :, k + 1 :] -= column[:, None] * column
    return a, least


def inverse_factor(matrix: Float[np.ndarray, "n n batch"]) -> np.ndarray:
    """Return the inverses of the factors L of L Lᵀ."""
    factor = cholesky(matrix)[0]
    n = len(factor)
    inverse = np.zeros_like(factor)
    for k in range(n):
        inverse[k, k] = 1.0
        inverse[k, : k + 1] *= factor[k, k]
        if k + 1 < n:
            inverse[k + 1 :, : k + 1] -= factor[k + 1 :, k, None] * inverse[k, : k + 1]
    return inverse


def solve(inverse: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the solutions of the linear systems with the result of `inverse_factor`."""
    return np.einsum("jib,jb->ib", inverse, np.einsum("ijb,jb->ib", inverse, known))
