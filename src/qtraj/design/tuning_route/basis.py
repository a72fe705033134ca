"""Evaluate quintic segments from the states at their ends, and integrate their squared derivatives.

A segment of duration h is r(u) = Σ H_l(u) y_l for 0 ≤ u ≤ 1, with the six quintic Hermite functions H_l. The scaled end
states y are p, hv and h²a at the start and at the end, where p is the position, v the velocity and a the acceleration.
They have the unit of length. Derivatives are with respect to u, so that the matrices are the same for all segments.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial as power

from qtraj.path import pieces

POWERS = (0, 1, 2, 0, 1, 2)
"""The power of the duration h in each of the six scaled end states."""

CELLS = 10
"""Number of cells of a segment; limits are imposed at the nodes between the cells and at both ends."""

FINER = 8
"""Number of parts of a cell on the finer grid, from which the largest values are computed."""

NODES = np.linspace(0.0, 1.0, CELLS + 1)

FINE_NODES = np.linspace(0.0, 1.0, CELLS * FINER + 1)


def lifted(x: Any, dimensions: int) -> Any:
    """Add leading axes of length 1 to an array, so that its number of dimensions is `dimensions`."""
    return x.reshape((1,) * (dimensions - x.ndim) + x.shape)


def _polynomials() -> list[np.ndarray]:
    """Return the ascending coefficients of each Hermite function H_l."""
    data = np.eye(6).reshape(2, 3, 6)
    return list(pieces.hermite(np.ones(1), data)[0].T)


def at_nodes(nodes: np.ndarray, order: int) -> Float[np.ndarray, "{order}+1 nodes 6"]:
    """Return the Hermite functions H_l and their derivatives with respect to u up to `order`."""
    rows = [[power.polyval(nodes, power.polyder(c, k)) for c in _polynomials()] for k in range(order + 1)]
    return np.moveaxis(np.array(rows), 1, 2)


def gram(order: int) -> Any:
    """Return the matrix (6, 6) of ∫ H_l⁽ᵏ⁾ H_m⁽ᵏ⁾ du over the segment for the Hermite functions H_l and k = `order`."""
    x, weights = np.polynomial.legendre.leggauss(8)
    values = at_nodes((x + 1) / 2, order)[order]
    return np.einsum("j,jl,jm->lm", weights / 2, values, values)
