"""Evaluate quintic segments from the states at their ends, and integrate their squared derivatives.

A segment of duration h is r(u) = Σ H_l(u) y_l for 0 ≤ u ≤ 1, with the six quintic Hermite functions H_l. The scaled end
states y are p, hv and h²a at the start and at the end, where p is the position, v the velocity and a the acceleration.
They have the unit of length. Derivatives are with respect to u, so that the matrices are the same for all segments.
"""

from functools import cache
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


def clustered(nodes: Float[np.ndarray, " nodes"]) -> Float[np.ndarray, " nodes"]:
    """Return nodes that are closer to each other near the ends of a segment (Chebyshev).

    Curves with a progress have such nodes: next to a stop, much time passes on little of the curve.
    """
    return 0.5 * (1.0 - np.cos(np.pi * nodes))


def places(composed: Any, count: int, fine: bool = False) -> Float[np.ndarray, "nodes n"]:
    """Return the nodes of `count` segments; `composed` (n,) marks curves with a progress, None if there are none."""
    nodes = np.tile((FINE_NODES if fine else NODES)[:, None], (1, count))
    return nodes if composed is None else np.where(composed, clustered(nodes), nodes)


def at_nodes(nodes: np.ndarray, order: int) -> Float[np.ndarray, "{order}+1 nodes 6"]:
    """Return the Hermite functions H_l and their derivatives with respect to u up to `order`."""
    functions = pieces.hermite(np.ones(1), np.eye(6).reshape(2, 3, 6))[0].T
    rows = [[power.polyval(nodes, power.polyder(c, k)) for c in functions] for k in range(order + 1)]
    return np.moveaxis(np.array(rows), 1, 2)


@cache
def table(order: int, fine: bool = False, dense: bool = False) -> Float[np.ndarray, "{order}+1 nodes 6"]:
    """Return `at_nodes` for `NODES`, or for `FINE_NODES`; with `dense`, for `clustered` nodes."""
    nodes = FINE_NODES if fine else NODES
    return at_nodes(clustered(nodes) if dense else nodes, order)


@cache
def rows(count: int, first: int, fine: bool = False, dense: bool = False) -> Float[np.ndarray, "{count} nodes 6"]:
    """Return the rows of `table` for `count` orders from `first`, which is 0 or 1."""
    return table(count - 1 + first, fine, dense)[first:]


@cache
def products(count: int, first: int, dense: bool = False) -> Float[np.ndarray, "36 {count}*{count}*nodes"]:
    """Return the products H_l⁽ʲ⁾ H_m⁽ᵏ⁾ at the nodes for `count` orders j, k ≥ `first`; each row is a pair (l, m)."""
    own = rows(count, first, dense=dense)
    return np.einsum("jal,kam->lmjka", own, own).reshape(36, -1)


@cache
def squares(dense: bool = False) -> Float[np.ndarray, "36 nodes"]:
    """Return the products H_l H_m at the nodes; each row belongs to one pair (l, m)."""
    rows = table(0, dense=dense)[0]
    return np.einsum("al,am->lma", rows, rows).reshape(36, -1)


@cache
def roots(order: int, count: int) -> Float[np.ndarray, "{count} 6"]:
    """Return a matrix R with ∫ |r⁽ᵏ⁾|² du = |R y|², for k = `order` and the scaled end states y of a segment.

    Its rows belong to the `count` instants of Gauss's rule, which is exact for polynomials of degree 2·`count` − 1.
    """
    x, weights = np.polynomial.legendre.leggauss(count)
    return np.sqrt(weights / 2)[:, None] * at_nodes((x + 1) / 2, order)[order]


def gram(order: int) -> Float[np.ndarray, "6 6"]:
    """Return the matrix of ∫ H_l⁽ᵏ⁾ H_m⁽ᵏ⁾ du over the segment for the Hermite functions H_l and k = `order`."""
    return roots(order, 8).T @ roots(order, 8)
