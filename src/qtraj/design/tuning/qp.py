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

SMALL, FEW = 64, 0.75
"""Solved programs leave a batch of more than `SMALL` programs when less than the part `FEW` of it is unsolved."""


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


class _Program(NamedTuple):
    """A batch of programs in x = (d, t): minimise ½xᵀHx + gᵀx subject to A·x + c ≤ 0, d ≤ high and x ≥ low.

    `normals` are the rows of A, and `values` is c. The inequalities are in this order: constraints, upper and lower
    bounds.
    """

    hessian: Float[np.ndarray, "n+1 n+1 batch"]
    gradient: Float[np.ndarray, "n+1 batch"]
    normals: Float[np.ndarray, "k n+1 batch"]
    values: Float[np.ndarray, "k batch"]
    low: Float[np.ndarray, "n+1 batch"]
    high: Float[np.ndarray, "n batch"]
    tolerance: Float[np.ndarray, " batch"]

    def take(self, index: np.ndarray) -> "_Program":
        """Return some of the programs."""
        return _Program(*(x[..., index] for x in self))

    def along(self, step: np.ndarray) -> np.ndarray:
        """Return the changes of the left-hand sides of all inequalities for a step."""
        return np.concatenate([_product(self.normals, step), step[:-1], -step])

    def back(self, y: np.ndarray) -> np.ndarray:
        """Return the sum of the normals of all inequalities, weighted by `y`."""
        k, n = len(self.values), len(self.high)
        result = np.einsum("kib,kb->ib", self.normals, y[:k])
        result[:n] += y[k : k + n]
        result -= y[k + n :]
        return result

    def slacks(self, x: np.ndarray) -> np.ndarray:
        """Return the slacks of all inequalities."""
        return np.concatenate([-(_product(self.normals, x) + self.values), self.high - x[:-1], x - self.low])


def minimise(qp: QP) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the steps d (n, batch), the allowed violations t, and the multipliers of the constraints (k, batch)."""
    n, count = qp.gradient.shape
    k = len(qp.values)
    results = np.zeros((n + 1, count)), np.zeros((k, count))
    rest, on = np.arange(count), np.ones(count, bool)
    program = _program(qp)
    x, multipliers = _start(qp)
    last = x, multipliers
    for step in range(MAX_STEPS):
        slack = program.slacks(x)
        mean = np.einsum("mb,mb->b", slack, multipliers) / len(slack)
        open_ = mean > program.tolerance
        if step == MAX_STEPS - 1:
            open_[:] = False
        done = np.flatnonzero(on & ~open_)
        if done.size:
            lost = np.isnan(mean[done])  # the last step was beyond the rounding error of its program
            for result, now, before in zip(results, (x, multipliers[:k]), (last[0], last[1][:k]), strict=True):
                result[:, rest[done]] = np.where(lost, before[:, done], now[:, done])
            on[done] = False
            left = np.count_nonzero(on)
            if left == 0:
                break
            if rest.size > SMALL and left < FEW * rest.size:
                rest, program, x, multipliers = rest[on], program.take(on), x[:, on], multipliers[:, on]
                slack, mean, on = slack[:, on], mean[on], np.ones(left, bool)
        last = x, multipliers
        x, multipliers = _step(program, x, multipliers, slack, mean)
    return results[0][:n], results[0][n], results[1]


def _program(qp: QP) -> _Program:
    n, count = qp.gradient.shape
    k = len(qp.values)
    hessian, normals = np.zeros((n + 1, n + 1, count)), np.full((k, n + 1, count), -1.0)
    hessian[:n, :n], hessian[n, n], normals[:, :n] = qp.hessian, qp.stiffness, qp.normals
    gradient, low = (np.concatenate([x, y[None]]) for x, y in ((qp.gradient, qp.penalty), (qp.low, qp.lowest)))
    return _Program(hessian, gradient, normals, qp.values, low, qp.high, qp.tolerance)


def _start(qp: QP) -> tuple[np.ndarray, np.ndarray]:
    """Return the first variables (n+1, batch), and the first multipliers of all inequalities."""
    n, count = qp.gradient.shape
    k = len(qp.values)
    width = qp.high - qp.low
    d = np.clip(0.0, qp.low + 0.1 * width, qp.high - 0.1 * width)
    at = _product(qp.normals, d) + qp.values
    t = np.maximum(at.max(axis=0, initial=-np.inf), qp.lowest) + 1.0
    multipliers = np.ones((k + 2 * n + 1, count))
    multipliers[:k] = multipliers[-1] = qp.penalty / (k + 1)  # these balance the penalty
    return np.concatenate([d, t[None]]), multipliers


def _step(
    program: _Program, x: np.ndarray, multipliers: np.ndarray, slack: np.ndarray, mean: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    n, k = len(x) - 1, len(program.values)
    inverse_slack = 1 / slack
    weight = multipliers * inverse_slack
    matrix = np.einsum("kib,kjb->ijb", program.normals * weight[:k, None], program.normals)
    matrix += program.hessian
    diagonal = weight[k + n :]
    matrix[range(n + 1), range(n + 1)] += diagonal
    matrix[range(n), range(n)] += weight[k : k + n]
    inverse = inverse_factor(matrix)
    base = -_product(program.hessian, x) - program.gradient
    moved = program.along(solve(inverse, base))
    # The slacks change by −moved; the products of slacks and multipliers go to zero.
    change = weight * moved
    change -= multipliers
    length = _longest(moved * inverse_slack, change, multipliers)
    after = np.einsum("mb,mb->b", slack - length * moved, multipliers + length * change) / len(slack)
    # A short step means that some products are far below the mean: the next point must be more central.
    central = length < CENTRAL
    target = np.where(central, CENTRAL, (after / mean) ** 3) * mean
    change *= moved  # the product of the changes is −moved·change
    corrected = (target + np.where(central, 0.0, change)) * inverse_slack
    step = solve(inverse, base - program.back(corrected))
    moved = program.along(step)
    change = corrected - multipliers
    change += weight * moved
    length = TO_BOUNDARY * _longest(moved * inverse_slack, change, multipliers)
    return x + length * step, multipliers + length * change


def _product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.einsum("kib,ib->kb", matrix, vector)


def _longest(moved: np.ndarray, change: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
    """Return the longest step, at most 1, that keeps slacks and multipliers nonnegative; `moved` is per slack."""
    fastest = np.maximum(moved.max(axis=0), -(change / multipliers).min(axis=0))
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
    """Return the inverses of the factors L of L Lᵀ, by elimination in the matrix beside the identity."""
    n = len(matrix)
    rows = np.zeros((n, 2 * n, *matrix.shape[2:]))
    rows[:, :n] = matrix
    rows[range(n), range(n, 2 * n)] = 1.0
    for k in range(n):
        row = rows[k, k : n + k + 1]  # all other elements are zero, or not used again
        row /= np.sqrt(np.maximum(row[0], 1e-300))
        if k + 1 < n:
            rows[k + 1 :, k + 1 : n + k + 1] -= row[1 : n - k, None] * row[1:]
    return rows[:, n:]


def solve(inverse: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the solutions of the linear systems with the result of `inverse_factor`."""
    return np.einsum("jib,jb->ib", inverse, np.einsum("ijb,jb->ib", inverse, known))
