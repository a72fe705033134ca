"""Solve symmetric block-tridiagonal systems by LAPACK's band solver, in time proportional to the number of blocks.

A cyclic system, in which the last block is coupled to the first one, is solved as a block-tridiagonal system with a
border, by the Schur complement of the border.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.solve.program import Solver
from qtraj.foundation.namespace import xp


class Border(NamedTuple):
    """The rows and columns of block 0 of a cyclic system.

    `corner` is the diagonal block 0, and `side[i]` couples block i (rows) to block 0 (columns).
    """

    corner: Float[np.ndarray, "b b"]
    side: Float[np.ndarray, "n b b"]


class Chain(NamedTuple):
    """A symmetric block-tridiagonal matrix, or the matrix of a cyclic system.

    `diagonal` contains the diagonal blocks, and `lower[i]` couples block i + 1 (rows) to block i (columns). The
    `border` of a cyclic system contains all rows and columns of block 0; then `diagonal[0]` is the identity matrix, and
    `lower[0]` and `border.side[0]` are zero.
    """

    diagonal: Float[np.ndarray, "n b b"]
    lower: Float[np.ndarray, "n-1 b b"]
    border: Border | None = None

    def shifted(self, shift: Float[np.ndarray, "n b"]) -> Chain:
        """Return the matrix with `shift` added to its diagonal."""
        own = shift[:, :, None] * np.eye(shift.shape[1])
        if self.border is None:
            return self._replace(diagonal=self.diagonal + own)
        corner = self.border.corner + own[0]
        own[0] = 0.0
        return Chain(self.diagonal + own, self.lower, self.border._replace(corner=corner))

    def solver(self, indefinite: bool = False) -> Solver | None:
        """Return a function that solves systems with this matrix, or None if it is not positive definite.

        With `indefinite`, the result is None only for a singular matrix.
        """
        factored = _factored_with_pivots if indefinite else _factored
        whole = factored(_band(self.diagonal, self.lower))
        if whole is None or self.border is None:
            return whole
        corner, side = self.border
        found = whole(side)
        first = factored(_band((corner - np.einsum("nij,nik->jk", side, found))[None], self.lower[:0]))
        if first is None:
            return None

        def solve(right: Float[np.ndarray, "n b"]) -> Float[np.ndarray, "n b"]:
            rest = whole(np.concatenate([np.zeros_like(right[:1]), right[1:]]))
            own = first((right[0] - np.einsum("nij,ni->j", side, rest))[None])
            return np.concatenate([own, (rest - found @ own[0])[1:]])

        return solve

    def indefinite_block(self) -> int | None:
        """Return the block where the Cholesky factorisation fails; None if the matrix is positive definite.

        It is the last block of the shortest leading part of the matrix that is not positive definite. In a cyclic
        system, block 0 comes last.
        """
        row = _failing_row(_band(self.diagonal, self.lower))
        if row is not None:
            return row // self.diagonal.shape[1]
        return None if self.border is None or self.solver() is not None else 0

    def product(self, x: Float[Any, "n b"]) -> Float[Any, "n b"]:
        """Return the product of the matrix and a vector, in NumPy or JAX."""
        none = xp.zeros_like(x[:1])
        before = xp.einsum("nij,nj->ni", self.lower, x[:-1])
        after = xp.einsum("nij,ni->nj", self.lower, x[1:])
        found = xp.einsum("nij,nj->ni", self.diagonal, x)
        found = found + xp.concatenate([none, before]) + xp.concatenate([after, none])
        if self.border is None:
            return found
        corner, side = self.border
        first = xp.einsum("ij,j->i", corner, x[0]) + xp.einsum("nij,ni->j", side, x)
        rest = found + xp.einsum("nij,j->ni", side, x[0])
        return xp.concatenate([first[None], rest[1:]])


def _band(diagonal: Float[np.ndarray, "n b b"], lower: Float[np.ndarray, "n-1 b b"]) -> Float[np.ndarray, "rows 2b"]:
    """Return the lower triangle of a block-tridiagonal matrix by columns, each from its diagonal entry downwards."""
    n, b = diagonal.shape[:2]
    rows = np.zeros((n, b * (3 * b + 1)))
    # Column k of a block is row k here. In rows that are longer by one entry, all rows start at the diagonal.
    columns = rows[:, : 3 * b * b].reshape(n, b, 3 * b)
    columns[:, :, :b] = diagonal.swapaxes(1, 2)
    columns[:-1, :, b : 2 * b] = lower.swapaxes(1, 2)
    return rows.reshape(n, b, 3 * b + 1)[:, :, : 2 * b].reshape(n * b, 2 * b)


def _factored(band: Float[np.ndarray, "rows 2b"]) -> Callable[[np.ndarray], np.ndarray] | None:
    """Factorise a matrix from its lower triangle; return a function that solves systems with it.

    The function accepts arrays (n, b) or (n, b, columns). The result is None if the matrix is not positive definite.
    """
    from scipy.linalg import lapack  # slow to import, and most programs never solve a band system

    if not np.isfinite(band).all():
        return None
    factor, info = lapack.dpbtrf(band.T, lower=1, overwrite_ab=1)  # pyright: ignore[reportAttributeAccessIssue]
    if info:
        return None

    def solve(right: np.ndarray) -> np.ndarray:
        columns = right.reshape(len(band), -1)
        return lapack.dpbtrs(factor, columns, lower=1)[0].reshape(right.shape)  # pyright: ignore[reportAttributeAccessIssue]

    return solve


def _failing_row(band: Float[np.ndarray, "rows 2b"]) -> int | None:
    """Return the row where the Cholesky factorisation fails, 0 if there are NaNs, or None if it succeeds."""
    from scipy.linalg import lapack

    if not np.isfinite(band).all():
        return 0
    info = lapack.dpbtrf(band.T, lower=1, overwrite_ab=1)[1]  # pyright: ignore[reportAttributeAccessIssue]
    return info - 1 if info else None


def _factored_with_pivots(band: Float[np.ndarray, "rows 2b"]) -> Callable[[np.ndarray], np.ndarray] | None:
    """Do the same for a symmetric matrix that need not be positive definite; the result is None if it is singular."""
    from scipy.linalg import lapack

    if not np.isfinite(band).all():
        return None
    n, k = len(band), band.shape[1] - 1
    table = np.zeros((3 * k + 1, n))
    for d in range(min(k + 1, n)):
        table[2 * k + d, : n - d] = table[2 * k - d, d:] = band[: n - d, d]
    factor, pivots, info = lapack.dgbtrf(table, k, k)  # pyright: ignore[reportAttributeAccessIssue]
    if info:
        return None

    def solve(right: np.ndarray) -> np.ndarray:
        columns = right.reshape(n, -1)
        return lapack.dgbtrs(factor, k, k, columns, pivots)[0].reshape(right.shape)  # pyright: ignore[reportAttributeAccessIssue]

    return solve
