"""Covariances of the states of a fitted route: blocks of the inverse of its banded normal equations."""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.route_system import WIDTH, System, solve

STEP = 1e-30
"""An imaginary change, so small that the imaginary part of a result is its derivative times the change, exactly."""


def blocks(matrix: Float[np.ndarray, "6 unknowns"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the diagonal blocks (knots, 3, 3) of a banded matrix, and the blocks (knots − 1, 3, 3) to their right."""
    rows = np.zeros((matrix.shape[1] // 3, 3, 6), matrix.dtype)
    for d in range(WIDTH):
        for r in range(3):
            if r + d < WIDTH:
                column = matrix[WIDTH - 1 - d, r + d :: 3]
                rows[: len(column), r, r + d] = column
    diagonal = np.triu(rows[:, :, :3]) + np.swapaxes(np.triu(rows[:, :, :3], 1), 1, 2)
    return diagonal, rows[:-1, :, 3:]


def from_blocks(diagonal: np.ndarray, upper: np.ndarray) -> Float[np.ndarray, "6 unknowns"]:
    """Return the upper diagonals of the matrix with these blocks; see `blocks`."""
    matrix = np.zeros((WIDTH, 3 * len(diagonal)), diagonal.dtype)
    for r in range(3):
        for c in range(r, WIDTH):
            column = diagonal[:, r, c] if c < 3 else upper[:, r, c - 3]
            matrix[WIDTH - 1 - (c - r), c::3][: len(column)] = column
    return matrix


def covariances(matrix: Float[np.ndarray, "*axes 6 unknowns"]) -> Float[np.ndarray, "*axes knots 3 3"]:
    """Return the diagonal blocks (3, 3) of the inverse of a banded matrix, one per knot (Takahashi's recursion)."""
    if matrix.ndim == 3:
        return np.stack([covariances(axis) for axis in matrix])
    return _inverse_blocks(matrix)[0]


def segment_covariances(
    matrix: Float[np.ndarray, "*axes 6 unknowns"], penalty: Float[np.ndarray, "*axes 6 unknowns"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return two covariances (*axes, segments, 6, 6) of the unknowns at both ends of each segment.

    With the matrix A and the part K of it that is the penalty, the first is A⁻¹(A − K)A⁻¹, the effect of the errors of
    the samples on the estimate. The second is A⁻¹, for which the penalty is a prior distribution of the motion.
    −A⁻¹KA⁻¹ is the derivative of (A + εK)⁻¹ by ε.
    """
    if matrix.ndim == 3:
        pairs = [segment_covariances(*axis) for axis in zip(matrix, penalty, strict=True)]
        return np.stack([x for x, _ in pairs]), np.stack([x for _, x in pairs])
    own, beside = _inverse_blocks(matrix + 1j * STEP * penalty)
    found: Any = np.block([[own[:-1], beside], [np.swapaxes(beside, 1, 2), own[1:]]])
    return found.real + found.imag / STEP, found.real


def smoothing_errors(
    matrix: Float[np.ndarray, "*axes 6 unknowns"],
    penalty: Float[np.ndarray, "*axes 6 unknowns"],
    states: Float[np.ndarray, "knots 3 3"],
) -> Float[np.ndarray, "knots 3 3"]:
    """Return the expected errors −A⁻¹Kx of the states by the penalty, if `states` are the true states x.

    See `segment_covariances` for A and K. The result is for the unit of the states.
    """
    diagonal, upper = (np.stack(x) for x in zip(*map(blocks, penalty.reshape(-1, *penalty.shape[-2:])), strict=True))
    x = np.moveaxis(states, 2, 0)[..., None]
    product = diagonal @ x
    product[:, :-1] += upper @ x[:, 1:]
    product[:, 1:] += np.swapaxes(upper, -1, -2) @ x[:, :-1]
    return solve(System(matrix, -product.reshape(3, -1).T))


def _inverse_blocks(matrix: Float[np.ndarray, "6 unknowns"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the diagonal blocks (knots, 3, 3) of the inverse, and the blocks (knots − 1, 3, 3) to their right."""
    diagonal, upper = blocks(matrix)
    count = len(diagonal)
    pivots, ratios = np.empty_like(diagonal), np.empty_like(upper)
    pivots[0] = diagonal[0]
    for i in range(1, count):
        ratios[i - 1] = np.linalg.solve(pivots[i - 1], upper[i - 1])
        pivots[i] = diagonal[i] - upper[i - 1].T @ ratios[i - 1]
    result = np.linalg.inv(pivots)
    for i in range(count - 2, -1, -1):
        result[i] += ratios[i] @ result[i + 1] @ ratios[i].T
    return result, -ratios @ result[1:]
