"""Banded normal equations of a route that is fitted to recorded positions.

The unknowns are position, velocity and acceleration at the knots. The route at a sample is a linear combination of the
six states at the ends of its segment; the factors are Hermite polynomials. The integral of the squared jerk over a
segment is a quadratic form of the same six states. So the matrix has five diagonals above the main one, and the same
matrix serves x, y and z.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.path import pieces

WIDTH = 6
"""Number of states at both ends of a segment, per axis."""


def _basis() -> np.ndarray:
    """Ascending coefficients (6, 6) in u ∈ [0, 1] of the Hermite polynomials, one row for each state."""
    rows = []
    for k in range(WIDTH):
        states = np.zeros((2, 3, 1))
        states[k // 3, k % 3] = 1.0
        rows.append(pieces.hermite(np.ones(1), states)[0, :, 0])
    return np.array(rows)


BASIS = _basis()


def _jerk_form() -> np.ndarray:
    """∫ H_j''' H_k''' du over [0, 1]."""
    third = BASIS[:, 3:] * [math.factorial(k) / math.factorial(k - 3) for k in range(3, WIDTH)]
    powers = np.arange(3)
    return third @ (1 / (1 + powers[:, None] + powers[None])) @ third.T


JERK = _jerk_form()


class Design(NamedTuple):
    """The design matrix: for each sample, its segment and the factors of the six states at the ends of the segment."""

    segment: Int[np.ndarray, " n"]
    factors: Float[np.ndarray, "n 6"]

    def part(self, samples: Bool[np.ndarray, " n"]) -> "Design":
        """The rows of some samples."""
        return Design(self.segment[samples], self.factors[samples])


def design(knots: Float[np.ndarray, " m"], times: Float[np.ndarray, " n"], order: int = 0) -> Design:
    """The design matrix of positions (order 0) or velocities (order 1) at `times`."""
    i = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    h = (knots[1:] - knots[:-1])[i]
    u = (times - knots[i]) / h
    powers = np.ones((len(u), WIDTH - order))
    for k in range(1, powers.shape[1]):
        np.multiply(powers[:, k - 1], u, out=powers[:, k])
    factors = BASIS[:, order:] * (np.arange(order, WIDTH) if order else 1)
    values = powers @ factors.T
    return Design(i, values * _scales(h) / (h[:, None] if order else 1))


def _scales(h: np.ndarray) -> np.ndarray:
    """The factors (n, 6) that convert position, velocity and acceleration to lengths."""
    one, square = np.ones_like(h), h * h
    return np.stack([one, h, square, one, h, square], axis=1)


class System(NamedTuple):
    """Normal equations: the upper diagonals of the matrix (6, unknowns) and the right-hand sides (unknowns, 3)."""

    matrix: Float[np.ndarray, "6 unknowns"]
    right: Float[np.ndarray, "unknowns 3"]

    def plus(self, other: "System", factor: float = 1.0) -> "System":
        """The sum of this system and `factor` times another one."""
        return System(self.matrix + factor * other.matrix, self.right + factor * other.right)


def sample_system(count: int, at: Design, values: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"]) -> System:
    """The normal equations of weighted samples on `count` knots."""
    segments = count - 1
    weighted = at.factors * weights[:, None]
    blocks = np.empty((segments, WIDTH, WIDTH))
    sides = np.empty((segments, WIDTH, values.shape[1]))
    for j in range(WIDTH):
        for k in range(j, WIDTH):
            blocks[:, j, k] = np.bincount(at.segment, weighted[:, j] * at.factors[:, k], segments)
        for axis in range(values.shape[1]):
            sides[:, j, axis] = np.bincount(at.segment, weighted[:, j] * values[:, axis], segments)
    return System(_banded(blocks), _assembled(sides))


def jerk_system(knots: Float[np.ndarray, " m"]) -> System:
    """The normal equations of ∫ |r'''|² dt."""
    h = knots[1:] - knots[:-1]
    scales = _scales(h)
    blocks = JERK * scales[:, :, None] * scales[:, None, :] / h[:, None, None] ** 5
    return System(_banded(blocks), np.zeros((3 * len(knots), 3)))


def stop_system(knots: Float[np.ndarray, " m"], is_stop: np.ndarray, weight: float) -> System:
    """Weighted equations for stops.

    In each segment with `is_stop` (m − 1,), velocity and acceleration are zero at both ends, and both ends have the
    same position.
    """
    matrix = np.zeros((WIDTH, 3 * len(knots)))
    for end in (np.append(is_stop, False), np.append(False, is_stop)):
        matrix[-1, ::3][end] += weight
        matrix[-1, 1::3][end] += weight
        matrix[-1, 2::3][end] += weight
    matrix[-4, 3::3][is_stop] -= weight
    return System(matrix, np.zeros((3 * len(knots), 3)))


def solve(system: System) -> Float[np.ndarray, "knots 3 3"]:
    """The states at the knots (knots, order, axis) that satisfy the normal equations.

    **Raises:** numpy.linalg.LinAlgError if the samples do not determine them.
    """
    from scipy.linalg import solveh_banded

    solution = solveh_banded(system.matrix, system.right, check_finite=False)
    return solution.reshape(-1, 3, system.right.shape[1])


def predict(at: Design, states: Float[np.ndarray, "knots 3 3"]) -> Float[np.ndarray, "n 3"]:
    """The positions or velocities (n, 3) at the samples, on the route with these states at the knots."""
    both = np.concatenate([states[:-1], states[1:]], axis=1)[at.segment]
    return np.einsum("nk,nka->na", at.factors, both)


def covariances(matrix: Float[np.ndarray, "6 unknowns"]) -> Float[np.ndarray, "knots 3 3"]:
    """The diagonal blocks (3, 3) of the inverse of a banded matrix, one per knot (Takahashi's recursion)."""
    count = matrix.shape[1] // 3
    blocks = np.zeros((count, 3, 6))
    for d in range(WIDTH):
        for r in range(3):
            if r + d < WIDTH:
                column = matrix[WIDTH - 1 - d, r + d :: 3]
                blocks[: len(column), r, r + d] = column
    diagonal = np.triu(blocks[:, :, :3]) + np.swapaxes(np.triu(blocks[:, :, :3], 1), 1, 2)
    upper = blocks[:-1, :, 3:]
    pivots, ratios = np.empty_like(diagonal), np.empty_like(upper)
    pivots[0] = diagonal[0]
    for i in range(1, count):
        ratios[i - 1] = np.linalg.solve(pivots[i - 1], upper[i - 1])
        pivots[i] = diagonal[i] - upper[i - 1].T @ ratios[i - 1]
    result = np.linalg.inv(pivots)
    for i in range(count - 2, -1, -1):
        result[i] += ratios[i] @ result[i + 1] @ ratios[i].T
    return result


def _banded(blocks: Float[np.ndarray, "segments 6 6"]) -> np.ndarray:
    """The upper diagonals of a matrix of blocks (6, 6) that overlap by three."""
    segments = len(blocks)
    matrix = np.zeros((WIDTH, 3 * (segments + 1)))
    for j in range(WIDTH):
        for k in range(j, WIDTH):
            matrix[WIDTH - 1 - (k - j), k : k + 3 * segments : 3] += blocks[:, j, k]
    return matrix


def _assembled(sides: Float[np.ndarray, "segments 6 3"]) -> np.ndarray:
    """The right-hand sides of segments that share their knots."""
    result = np.zeros((len(sides) + 1, 3, sides.shape[2]))
    result[:-1] += sides[:, :3]
    result[1:] += sides[:, 3:]
    return result.reshape(-1, sides.shape[2])
