"""Solve symmetric positive definite band systems with LAPACK.

The systems of a batch are blocks of one band matrix, whose entries between blocks are zero. So one call of LAPACK
factorises all of them.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Factored(NamedTuple):
    """The Cholesky factor of all blocks in LAPACK's form, and a mask of the matrices that are not positive definite."""

    upper: Float[Any, "width n"]
    failed: Bool[Any, " batch"]


def factor(band: Float[Any, "batch n width"]) -> Factored:
    """Factorise matrices; row i of `band` contains the entries (i, i − width + 1) to (i, i) of a matrix.

    Entries before the first column must be zero. The array is overwritten.
    """
    from scipy.linalg import lapack  # slow to import, and most programs never solve a band system

    failed = ~np.isfinite(band.reshape(len(band), -1).sum(axis=1))  # faster than a test of each entry
    while True:
        if failed.any():
            band[failed] = np.eye(band.shape[2])[-1]
        upper, info = lapack.dpbtrf(band.reshape(-1, band.shape[2]).T)  # pyright: ignore[reportAttributeAccessIssue]
        if info <= 0:
            return Factored(upper, failed)
        failed[(info - 1) // band.shape[1]] = True


def solve(f: Factored, right: Float[Any, "batch n"]) -> Float[Any, "batch n"]:
    """Return the solutions of the linear systems; NaN for a matrix that is not positive definite."""
    from scipy.linalg import lapack

    failed = f.failed | ~np.isfinite(right).all(axis=1)
    if failed.any():
        right = np.where(failed[:, None], 0.0, right)
    found = lapack.dpbtrs(f.upper, right.ravel())[0]  # pyright: ignore[reportAttributeAccessIssue]
    found = found.reshape(right.shape)
    return np.where(failed[:, None], np.nan, found) if failed.any() else found
