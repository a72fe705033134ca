"""Evaluate clamped cubic splines with cells of unequal length at nodes, and convert them to power form.

A spline with n cells has n + 3 coefficients and is twice continuously differentiable. Cell j depends only on the
coefficients j to j + 3, so the matrix of every linear system for the coefficients has three subdiagonals. The nodes are
the n + 1 knots and one point inside each cell.

The functions of coefficients accept NumPy and JAX arrays. A batch of splines on the same cells has its axes before the
axes of the nodes.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.timing.seam import added, repeated
from qtraj.foundation.namespace import namespace

DEGREE = 3

ORDERS = 3
"""Number of orders: value, first and second derivative."""

REST_PLACE, REST_WEIGHT = 1 / 3, 2 / 3**0.5
"""Node and weight of the one-point Gauss quadrature for ∫ f(z)/√z dz over [0, 1], exact for linear f.

The integral is approximately the weight times the value of f(z)/√z at the node.
"""

Numbers = Float[Any, "..."]


class Nodes(NamedTuple):
    """The nodes of a spline; derivatives are with respect to the parameter in units of the knots.

    Column j contains knot j and the node inside cell j. The last column contains the last knot. The second node of this
    column does not exist; it is treated as a node at rest, so it has no influence.

    `place` are the parameters of the nodes, `weight` the weights of the integral over all cells, and `basis` the
    matrices from the coefficients j to j + 3 to values and derivatives. The first two axes of `basis` are the order of
    the derivative and the coefficient; `pairs` contains products of its entries (see `products`). `free` is 0 for the
    coefficient at an end whose value is fixed, as at an end at rest, where it is zero, and 1 for all others. `standing`
    is 1 for nodes at rest. `seam` is 1 for a lap, whose end is its start, otherwise 0 (see `seam`); the coefficients
    that repeat others are not free.
    """

    place: Float[Any, "2 cells+1"]
    weight: Float[Any, "2 cells+1"]
    basis: Float[Any, "3 4 2 cells+1"]
    pairs: Float[Any, "6 10 2 cells+1"]
    free: Float[Any, " cells+3"]
    standing: Float[Any, "2 cells+1"]
    seam: Any = np.zeros(())


def power_form(knots: Float[Any, " cells+1"], lap: bool = False) -> Float[Any, "4 4 cells"]:
    """Return the matrices from the four spline coefficients of a cell to its polynomial coefficients.

    Entry [p, k] is the contribution of coefficient k to the coefficient of zᵖ, where 0 ≤ z ≤ 1 is the position in the
    cell. The Cox–de Boor recursion is applied to polynomials in z. The knots of a `lap` continue periodically.
    """
    cells, t = knots.size - 1, _extended(knots, lap)
    start, length = knots[:-1], np.diff(knots)
    basis = [np.where(length > 0, 1.0, 0.0)[None]]
    for degree in range(1, DEGREE + 1):
        new = [np.zeros((degree + 1, cells)) for _ in range(degree + 1)]
        for k, lower in enumerate(basis):  # the function whose support ends k + 1 knots after the start of the cell
            left = t[np.arange(cells) + DEGREE + k + 1 - degree]
            right = t[np.arange(cells) + DEGREE + k + 1]
            inverse = np.divide(1.0, right - left, out=np.zeros(cells), where=length > 0)
            grows = np.stack([(start - left) * inverse, length * inverse])
            falls = np.stack([(right - start) * inverse, -length * inverse])
            for power in range(2):
                new[k][power : power + degree] += falls[power] * lower
                new[k + 1][power : power + degree] += grows[power] * lower
        basis = new
    return np.stack(basis, axis=1)


def inserted(
    knots: Float[np.ndarray, " cells+1"],
    powers: Float[np.ndarray, "coarse 4"],
    coarse: Float[np.ndarray, " coarse+1"],
    lap: bool = False,
) -> Float[np.ndarray, " cells+3"]:
    """Return the coefficients of a given spline for cells that divide its cells.

    `powers` are the coefficients of the spline in its cells, between the knots `coarse`, for powers of the position
    from 0 to 1. A coefficient is the blossom (the symmetric trilinear form) of a cubic at three consecutive knots.
    """
    t = _extended(knots, lap)
    if lap:
        span = coarse[-1] - coarse[0]
        coarse = np.concatenate([coarse[:-1] - span, coarse, coarse[1:] + span])
        powers = np.tile(powers, (3, 1))
    three = np.stack([t[k : k + knots.size + DEGREE - 1] for k in (1, 2, 3)])
    wide = [t[k + 1 : k + knots.size + DEGREE] - t[k : k + knots.size + DEGREE - 1] for k in range(DEGREE + 1)]
    first = np.argmax(np.stack(wide[1:3] + wide[:1] + wide[3:]) > 0, axis=0)  # a cell that is not empty
    place = np.array([1, 2, 0, 3])[first] + np.arange(first.size)
    cell = np.clip(np.searchsorted(coarse, 0.5 * (t[place] + t[place + 1]), side="right") - 1, 0, len(powers) - 1)
    x, y, z = (three - coarse[cell]) / np.diff(coarse)[cell]
    c = powers[cell].T
    return c[0] + c[1] * (x + y + z) / 3 + c[2] * (x * y + y * z + z * x) / 3 + c[3] * x * y * z


def _extended(knots: Float[np.ndarray, " cells+1"], lap: bool) -> Float[np.ndarray, " cells+7"]:
    """Return the knots with three more at each end: the ends repeated, or those of the laps before and after."""
    if not lap:
        return np.concatenate([knots[:1].repeat(DEGREE), knots, knots[-1:].repeat(DEGREE)])
    span = knots[-1] - knots[0]
    return np.concatenate([knots[-1 - DEGREE : -1] - span, knots, knots[1 : 1 + DEGREE] + span])


def nodes(
    knots: Float[Any, " cells+1"],
    rest: tuple[bool, bool],
    lap: bool = False,
    held: tuple[bool, bool] = (False, False),
) -> Nodes:
    """Return the nodes; `rest` indicates whether the spline is zero at the start and at the end.

    The spline of a `lap` is periodic. `held` indicates at which ends another value of the spline is fixed.
    """
    length, cells = np.diff(knots), knots.size - 1
    inner, at_knots, inside, ends = np.full(cells, 0.5), np.zeros(cells + 1), np.full(cells, 4.0), np.ones((2, cells))
    for side, (is_at_rest, cell) in enumerate(zip(rest, (0, -1), strict=True)):
        if is_at_rest:
            inner[cell] = (REST_PLACE, 1 - REST_PLACE)[side]
            inside[cell], ends[:, cell] = 6 * REST_WEIGHT, 0.0
    at_knots[:-1] += length * ends[0] / 6
    at_knots[1:] += length * ends[1] / 6
    form = power_form(knots, lap)
    # At the end of a cell, the first of its coefficients has no influence.
    last = np.roll(_at(form, np.ones(cells), length), -1, axis=1)
    last[:, -1] = 0.0
    at_each = np.concatenate([_at(form, np.zeros(cells), length), last[..., -1:]], axis=-1)
    empty = np.append(length == 0, False)
    first = empty[1:-1] & ~empty[:-2]
    at_each[..., 1:-1] = np.where(first, last[..., :-1], at_each[..., 1:-1])
    free, standing = np.ones(cells + DEGREE), np.zeros((2, cells + 1))
    free[0], free[-1] = (1.0 - (is_at_rest or fixed) for is_at_rest, fixed in zip(rest, held, strict=True))
    free[-DEGREE:] *= not lap
    standing[:] = empty
    standing[0, 1:-1][first] = 0.0
    standing[0, 0], standing[0, -1], standing[1, -1] = *rest, 1.0
    basis = np.stack([at_each, np.pad(_at(form, inner, length), [(0, 0), (0, 0), (0, 1)])], axis=2)
    return Nodes(
        np.stack([knots, np.append(knots[:-1] + inner * length, knots[-1])]),
        np.stack([at_knots, np.append(length * inside / 6, 0.0)]),
        basis,
        products(basis),
        free,
        standing,
        np.asarray(float(lap)),
    )


def _at(form: Numbers, place: Numbers, length: Numbers) -> Float[Any, "3 4 cells"]:
    safe = np.where(length > 0, length, 1.0)
    return np.einsum("dpn,pkn->dkn", _powers(place), form) / safe ** np.arange(ORDERS)[:, None, None]


def _powers(z: Float[np.ndarray, " n"]) -> Float[np.ndarray, "3 4 n"]:
    """Return 1, z, z² and z³, and their first and second derivatives."""
    one = np.ones_like(z)
    return np.stack([[one, z, z**2, z**3], [0 * z, one, 2 * z, 3 * z**2], [0 * z, 0 * z, 2 * one, 6 * z]])


def local(coefficients: Float[Any, "*batch cells+3"]) -> Float[Any, "4 *batch cells"]:
    """Return the four coefficients of each cell."""
    cells = coefficients.shape[-1] - DEGREE
    return namespace(coefficients).stack([coefficients[..., k : k + cells] for k in range(DEGREE + 1)])


def at_nodes(
    n: Nodes, coefficients: Float[Any, "*batch cells+3"], orders: int = ORDERS
) -> Float[Any, "orders *batch 2 cells+1"]:
    """Return value and derivatives at the nodes."""
    xp, coefficients = namespace(coefficients), repeated(coefficients, n.seam)
    own = local(xp.concatenate([coefficients, xp.zeros_like(coefficients[..., :1])], axis=-1))
    return xp.einsum("okmn,k...n->o...mn", n.basis[:orders], own)


class Within(NamedTuple):
    """The result of `power_form`, and the lengths of the cells; that of an empty cell is 1, and its basis is zero."""

    powers: Float[Any, "4 4 cells"]
    lengths: Float[Any, " cells"]

    @property
    def cells(self) -> int:
        """The number of cells."""
        return self.lengths.shape[-1]

    def values(
        self, coefficients: Float[Any, "*batch cells+3"], count: int, orders: int
    ) -> Float[Any, "orders *batch {count} cells"]:
        """Return value and derivatives at `count` equidistant points in each cell, both ends included."""
        xp, z = namespace(coefficients), np.linspace(0.0, 1.0, count)
        powers = xp.einsum("pkn,k...n->p...n", self.powers, local(coefficients))
        at = np.moveaxis(_powers(z), 1, -1)[:orders]
        found = xp.moveaxis(xp.tensordot(at, powers, axes=1), 1, -2)
        scales = xp.stack([self.lengths ** (-1.0 * k) for k in range(orders)])
        return xp.einsum("o...pn,on->o...pn", found, scales)


def gathered(n: Nodes, parts: Float[Any, "orders *batch 2 cells+1"]) -> Float[Any, "*batch cells+3"]:
    """Convert a gradient with respect to values and derivatives at the nodes to one with respect to coefficients."""
    found = namespace(parts).einsum("okmn,o...mn->k...n", n.basis[: parts.shape[0]], parts)
    return added(_overlapped(found, range(DEGREE + 1)), n.seam)


PAIRS = np.array([(k, k - d) for d in range(DEGREE + 1) for k in range(d, DEGREE + 1)])
"""Pairs of coefficients of a cell, diagonal by diagonal."""

FIRST_PAIRS = [0, 4, 7, 9, 10]
"""The first pair of each diagonal, and the number of all pairs."""


def products(basis: Float[Any, "orders 4 2 cells+1"]) -> Float[Any, "entries pairs 2 cells+1"]:
    """Return the table of `gathered_band`: products of two values of the basis, for each pair of coefficients.

    The entries are those of the lower triangle of a matrix at the nodes, row by row.
    """
    first, second = (basis[:, PAIRS[:, side]] for side in range(2))
    entries = zip(*np.tril_indices(len(basis)), strict=True)
    return np.stack([first[i] * second[j] + (first[j] * second[i] if i != j else 0.0) for i, j in entries])


def gathered_band(
    n: Nodes, entries: Float[Any, "entries *batch 2 cells+1"]
) -> tuple[Float[Any, "*batch cells+3"], ...]:
    """Convert second derivatives at the nodes to second derivatives with respect to the coefficients (see `gathered`).

    `entries` are those of the lower triangles of the matrices at the nodes, row by row. Any d of the result contains
    the entries (i, i − d) of the matrix for the coefficients.
    """
    found = np.einsum("eqmn,e...mn->q...n", n.pairs[: len(entries)], entries)
    parts = itertools.pairwise(FIRST_PAIRS)
    return tuple(_overlapped(found[first:end], range(d, DEGREE + 1)) for d, (first, end) in enumerate(parts))


def _overlapped(rows: Float[Any, "rows *batch cells+1"], firsts: range) -> Float[Any, "*batch cells+3"]:
    """Return the sum of the rows; each starts at the coefficient in `firsts`.

    The last entry of the last row is zero.
    """
    count = rows.shape[-1]
    xp, shape = namespace(rows), (*rows.shape[1:-1], count + DEGREE)
    if xp is np:
        total = np.zeros(shape)
        for k, row in zip(firsts, rows, strict=True):
            total[..., k : k + count] += row
    else:
        total = xp.zeros(shape, rows.dtype)
        for k, row in zip(firsts, rows, strict=True):
            total = total.at[..., k : k + count].add(row)
    return total[..., :-1]
