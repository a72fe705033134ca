"""Banded normal equations of a route that is fitted to recorded positions.

The unknowns are position, velocity and acceleration at the knots. The position of the route at the time of a sample is
a linear combination of the six unknowns at the two ends of the segment. The coefficients are values of the quintic
Hermite basis functions. The integral of the squared jerk over a segment is a quadratic form in the same six unknowns.
So the matrix has five diagonals above the main diagonal. x, y and z share one matrix, unless their weights differ.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.path import pieces

WIDTH = 6
"""Number of unknowns of a segment per axis: position, velocity and acceleration at both ends."""


def _basis() -> np.ndarray:
    """Return the coefficients (6, 6) of ascending powers of u in the Hermite basis functions on [0, 1].

    Each row belongs to one unknown.
    """
    rows = []
    for k in range(WIDTH):
        states = np.zeros((2, 3, 1))
        states[k // 3, k % 3] = 1.0
        rows.append(pieces.hermite(np.ones(1), states)[0, :, 0])
    return np.array(rows)


BASIS = _basis()


def _jerk_form() -> np.ndarray:
    """Return the matrix (6, 6) of the integrals ∫ H_j''' H_k''' du over [0, 1] of the Hermite basis functions H_j."""
    third = BASIS[:, 3:] * [math.factorial(k) / math.factorial(k - 3) for k in range(3, WIDTH)]
    powers = np.arange(3)
    return third @ (1 / (1 + powers[:, None] + powers[None])) @ third.T


JERK = _jerk_form()


SOFT, SOFTEST = 3, 0.3
"""Number of segments at each end with a smaller weight of the jerk, and the weight of the outermost one."""


@dataclass(frozen=True, eq=False)
class Design:
    """The design matrix of a route with `knots` knots.

    For each sample, `segment` is the index of its segment, in increasing order. `factors` are the coefficients of the
    six unknowns of this segment in the position or velocity at the sample.
    """

    segment: Int[np.ndarray, " n"]
    factors: Float[np.ndarray, "n 6"]
    knots: int

    def part(self, samples: Bool[np.ndarray, " n"]) -> "Design":
        """Return the rows of the samples in the mask `samples`."""
        return Design(self.segment[samples], self.factors[samples], self.knots)

    def scaled(self, factors: Float[np.ndarray, " n"] | None) -> "Design":
        """Return the design matrix with its rows multiplied by `factors`; None means 1."""
        return self if factors is None else Design(self.segment, self.factors * factors[:, None], self.knots)

    @cached_property
    def matrix(self) -> Any:
        """The design matrix (n, 3·knots) as a sparse array of SciPy."""
        from scipy.sparse import csr_array

        columns = (3 * self.segment[:, None] + np.arange(WIDTH)).astype(np.int32)
        ends = np.arange(0, columns.size + 1, WIDTH, dtype=np.int32)
        return csr_array((self.factors.ravel(), columns.ravel(), ends), shape=(len(columns), 3 * self.knots))


def design(
    knots: Float[np.ndarray, " m"],
    times: Float[np.ndarray, " n"],
    order: int = 0,
    sense: Float[np.ndarray, " segments"] | None = None,
) -> Design:
    """Return the design matrix of the positions (order 0), or of a derivative of another order, at `times`.

    `sense` is the direction of each segment (see `qtraj.path.pieces.hermite`); None means forwards.
    """
    i = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    h = (knots[1:] - knots[:-1])[i]
    u = (times - knots[i]) / h
    powers = np.ones((len(u), WIDTH - order))
    for k in range(1, powers.shape[1]):
        np.multiply(powers[:, k - 1], u, out=powers[:, k])
    factors = BASIS[:, order:] * [math.perm(k, order) for k in range(order, WIDTH)]
    values = powers @ factors.T
    own = None if sense is None else sense[i]
    return Design(i, values * _scales(h, own) / (h[:, None] ** order if order else 1), len(knots))


def _scales(h: np.ndarray, sense: np.ndarray | None = None) -> np.ndarray:
    """Return the factors (n, 6) that convert the six unknowns to lengths, for segments with durations `h` (n,)."""
    one, square, first = np.ones_like(h), h * h, h if sense is None else h * sense
    return np.stack([one, first, square, one, first, square], axis=1)


class System(NamedTuple):
    """Normal equations: the diagonals of the upper triangle of the matrix, and the right-hand sides for x, y and z.

    The matrix has a leading axis for x, y and z if their weights differ.
    """

    matrix: Float[np.ndarray, "*axes 6 unknowns"]
    right: Float[np.ndarray, "unknowns columns"]

    def plus(self, other: "System", factor: float = 1.0) -> "System":
        """Return the sum of this system and `factor` times the other system."""
        return System(self.matrix + factor * other.matrix, self.right + factor * other.right)


def sample_system(at: Design, values: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n *axes"]) -> System:
    """Return the normal equations of samples with weights (n,) or (n, 3)."""
    if weights.ndim == 2:
        axes = [sample_system(at, values[:, k : k + 1], weights[:, k]) for k in range(3)]
        return System(np.stack([axis.matrix for axis in axes]), np.hstack([axis.right for axis in axes]))
    factors = np.ascontiguousarray(at.factors.T)  # sums over contiguous samples are faster
    weighted = factors * weights
    starts = np.flatnonzero(np.diff(at.segment, prepend=-1))
    blocks = np.zeros((WIDTH, WIDTH, at.knots - 1))
    for j in range(WIDTH):
        for k in range(j, WIDTH):
            blocks[j, k, at.segment[starts]] = np.add.reduceat(weighted[j] * factors[k], starts)
    return System(_banded(blocks), at.matrix.T @ (weights[:, None] * values))


def jerk_system(
    knots: Float[np.ndarray, " m"],
    stiffness: Float[np.ndarray, " segments"] | float = 1.0,
    sense: Float[np.ndarray, " segments"] | None = None,
) -> System:
    """Return the normal equations of ∫ |r'''|² dt times `stiffness`, with smaller weights in the segments at both ends.

    The minimum of the integral has zero jerk at the ends, which the motion does not have. With full weights, the
    derivatives there would be more than three times as inaccurate as their covariance states; with much smaller ones,
    they would follow the noise.
    """
    h = knots[1:] - knots[:-1]
    scales, weights = _scales(h, sense), np.ones(len(h))
    if len(h) > 3 * SOFT:
        weights[:SOFT] = SOFTEST ** (1 - np.arange(SOFT) / SOFT)
        weights[-SOFT:] = weights[SOFT - 1 :: -1]
    squares = JERK[:, :, None] * scales.T[:, None] * scales.T[None] * (stiffness * weights / h**5)
    return System(_banded(squares), np.zeros((3 * len(knots), 3)))


def stop_system(knots: Float[np.ndarray, " m"], is_stop: np.ndarray, weight: float) -> System:
    """Return the normal equations of stops, multiplied by `weight`.

    In each segment that `is_stop` (m − 1,) marks, velocity and acceleration are zero at both ends, and both ends have
    the same position.
    """
    matrix = np.zeros((WIDTH, 3 * len(knots)))
    for end in (np.append(is_stop, False), np.append(False, is_stop)):
        matrix[-1, ::3][end] += weight
        matrix[-1, 1::3][end] += weight
        matrix[-1, 2::3][end] += weight
    matrix[-4, 3::3][is_stop] -= weight
    return System(matrix, np.zeros((3 * len(knots), 3)))


def solve(system: System) -> Float[np.ndarray, "knots 3 3"]:
    """Return the states (knots, order, axis) that satisfy the normal equations; order is the order of the derivative.

    **Raises:** ValueError if the states are not determined within rounding errors.
    """
    from scipy.linalg import LinAlgError, solveh_banded

    matrices = system.matrix if system.matrix.ndim == 3 else system.matrix[None]
    rights = np.split(system.right, len(matrices), axis=1)
    try:
        columns = [solveh_banded(m, x, check_finite=False) for m, x in zip(matrices, rights, strict=True)]
    except LinAlgError as error:
        raise ValueError(
            "the samples do not determine the route with these knots and this smoothing: pass fewer knots, or a "
            "smoothing that is closer to the one chosen by default"
        ) from error
    solution = np.concatenate(columns, axis=1)
    return solution.reshape(-1, 3, system.right.shape[1])


def predict(at: Design, states: Float[np.ndarray, "knots 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Return the positions or velocities at the n samples, on the route with `states` at the knots."""
    return at.matrix @ states.reshape(3 * len(states), -1)


def in_seconds(matrix: Float[np.ndarray, "*axes 6 unknowns"], unit: float) -> np.ndarray:
    """Return the matrix for velocities and accelerations in seconds, if it is for those in units of time `unit` [s].

    The unit of length remains, because the matrix is in units of the variance of the positions.
    """
    column = np.arange(matrix.shape[-1])
    row = column - np.arange(WIDTH - 1, -1, -1)[:, None]
    return matrix * unit ** (row % 3 + column % 3)


def _banded(blocks: Float[np.ndarray, "6 6 segments"]) -> np.ndarray:
    """Return the upper diagonals of the matrix that is the sum of the blocks (6, 6) of all segments.

    In this matrix, each block is three rows and columns after the block of the previous segment.
    """
    segments = blocks.shape[-1]
    matrix = np.zeros((WIDTH, 3 * (segments + 1)))
    for j in range(WIDTH):
        for k in range(j, WIDTH):
            matrix[WIDTH - 1 - (k - j), k : k + 3 * segments : 3] += blocks[j, k]
    return matrix
