"""The normal equations of a route through recorded positions: banded, because a sample touches two joints only.

Unknown are position, velocity and acceleration at the joints. A sample between two of them is the sum of six Hermite
polynomials; the squares of the jerk of a segment are a quadratic form of the same six numbers. So the matrix has five
diagonals beside its main one, and is shared by x, y and z.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.path import pieces

WIDTH = 6
"""Unknowns that a segment touches: the states at both its ends."""


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


class Rows(NamedTuple):
    """What each sample is made of: the segment it lies in and the factors of the six states at its ends."""

    segment: Int[np.ndarray, " n"]
    factors: Float[np.ndarray, "n 6"]


def rows(knots: Float[np.ndarray, " m"], times: Float[np.ndarray, " n"], order: int = 0) -> Rows:
    """The factors of positions (order 0) or velocities (order 1) at `times`."""
    i = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    h = (knots[1:] - knots[:-1])[i]
    u = (times - knots[i]) / h
    powers = np.ones((len(u), WIDTH - order))
    for k in range(1, powers.shape[1]):
        np.multiply(powers[:, k - 1], u, out=powers[:, k])
    factors = BASIS[:, order:] * (np.arange(order, WIDTH) if order else 1)
    values = powers @ factors.T
    return Rows(i, values * _scales(h) / (h[:, None] if order else 1))


def _scales(h: np.ndarray) -> np.ndarray:
    """The factors that turn states into lengths, (n, 6)."""
    one, square = np.ones_like(h), h * h
    return np.stack([one, h, square, one, h, square], axis=1)


class System(NamedTuple):
    """The matrix, upper diagonals in rows (6, unknowns), and the right-hand sides (unknowns, 3)."""

    matrix: Float[np.ndarray, "6 unknowns"]
    right: Float[np.ndarray, "unknowns 3"]

    def plus(self, other: "System", factor: float = 1.0) -> "System":
        """The sum with a multiple of another system."""
        return System(self.matrix + factor * other.matrix, self.right + factor * other.right)


def of_samples(count: int, at: Rows, values: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"]) -> System:
    """The normal equations of samples with weights, on `count` knots."""
    segments = count - 1
    weighted = at.factors * weights[:, None]
    blocks = np.empty((segments, WIDTH, WIDTH))
    sides = np.empty((segments, WIDTH, values.shape[1]))
    for j in range(WIDTH):
        for k in range(j, WIDTH):
            blocks[:, j, k] = np.bincount(at.segment, weighted[:, j] * at.factors[:, k], segments)
        for axis in range(values.shape[1]):
            sides[:, j, axis] = np.bincount(at.segment, weighted[:, j] * values[:, axis], segments)
    return System(_banded(blocks), _stacked(sides))


def of_jerk(knots: Float[np.ndarray, " m"]) -> System:
    """The normal equations of ∫ |r'''|² dt."""
    h = knots[1:] - knots[:-1]
    scales = _scales(h)
    blocks = JERK * scales[:, :, None] * scales[:, None, :] / h[:, None, None] ** 5
    return System(_banded(blocks), np.zeros((3 * len(knots), 3)))


def of_stops(knots: Float[np.ndarray, " m"], standing: np.ndarray, weight: float) -> System:
    """Rest at both ends of the segments that are `standing` (m − 1,), and one position, with a weight."""
    matrix = np.zeros((WIDTH, 3 * len(knots)))
    for end in (np.append(standing, False), np.append(False, standing)):
        matrix[-1, ::3][end] += weight
        matrix[-1, 1::3][end] += weight
        matrix[-1, 2::3][end] += weight
    matrix[-4, 3::3][standing] -= weight
    return System(matrix, np.zeros((3 * len(knots), 3)))


def solved(system: System) -> Float[np.ndarray, "knots 3 3"]:
    """The joint states (knots, order, axis).

    **Raises:** numpy.linalg.LinAlgError where the samples do not determine them.
    """
    from scipy.linalg import solveh_banded

    found = solveh_banded(system.matrix, system.right, check_finite=False)
    return found.reshape(-1, 3, system.right.shape[1])


def predicted(at: Rows, states: Float[np.ndarray, "knots 3 3"]) -> Float[np.ndarray, "n 3"]:
    """What the samples are on the route with these joint states."""
    both = np.concatenate([states[:-1], states[1:]], axis=1)[at.segment]
    return np.einsum("nk,nka->na", at.factors, both)


def covariances(matrix: Float[np.ndarray, "6 unknowns"]) -> Float[np.ndarray, "knots 3 3"]:
    """The blocks (3, 3) of the inverse of a banded matrix that belong to one joint each (Takahashi's recursion)."""
    count = matrix.shape[1] // 3
    whole = np.zeros((count, 3, 6))
    for d in range(WIDTH):
        for r in range(3):
            if r + d < WIDTH:
                column = matrix[WIDTH - 1 - d, r + d :: 3]
                whole[: len(column), r, r + d] = column
    own = np.triu(whole[:, :, :3]) + np.swapaxes(np.triu(whole[:, :, :3], 1), 1, 2)
    beside = whole[:-1, :, 3:]
    pivots, ratios = np.empty_like(own), np.empty_like(beside)
    pivots[0] = own[0]
    for i in range(1, count):
        ratios[i - 1] = np.linalg.solve(pivots[i - 1], beside[i - 1])
        pivots[i] = own[i] - beside[i - 1].T @ ratios[i - 1]
    inverses = np.linalg.inv(pivots)
    found = inverses.copy()
    for i in range(count - 2, -1, -1):
        found[i] += ratios[i] @ found[i + 1] @ ratios[i].T
    return found


def _banded(blocks: Float[np.ndarray, "segments 6 6"]) -> np.ndarray:
    """Upper triangles of blocks that overlap by three, as diagonals."""
    segments = len(blocks)
    matrix = np.zeros((WIDTH, 3 * (segments + 1)))
    for j in range(WIDTH):
        for k in range(j, WIDTH):
            matrix[WIDTH - 1 - (k - j), k : k + 3 * segments : 3] += blocks[:, j, k]
    return matrix


def _stacked(sides: Float[np.ndarray, "segments 6 3"]) -> np.ndarray:
    found = np.zeros((len(sides) + 1, 3, sides.shape[2]))
    found[:-1] += sides[:, :3]
    found[1:] += sides[:, 3:]
    return found.reshape(-1, sides.shape[2])
