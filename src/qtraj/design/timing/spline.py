"""Clamped cubic splines with cells of unequal length: values at nodes, and the power form.

A spline with n cells has n + 3 coefficients and is twice continuously differentiable. Cell j depends only on the
coefficients j to j + 3, so the matrix of every linear system for the coefficients has three subdiagonals. The nodes are
the n + 1 knots, at which the values depend on three coefficients, and one place inside each cell.
"""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

DEGREE = 3

ORDERS = 3
"""Value, first and second derivative."""

REST_PLACE, REST_WEIGHT = 1 / 3, 2 / 3**0.5
"""Gauss quadrature with one node for ∫ f(z)/√z dz, exact for a linear f: the node, and the weight of f/√z there."""

Numbers = Float[np.ndarray, "..."]


class Nodes(NamedTuple):
    """The nodes of a spline, knots first; derivatives are with respect to the parameter in units of the knots.

    `place`: the parameters of the nodes; `weight`: the weights of the integral over all cells; `knot` (orders, 3,
    n + 1) and `inner` (orders, 4, n): the matrices from coefficients to values and derivatives. `free` is 0 for the
    coefficient at an end at rest, which must be zero, and 1 for all others; `standing` is 1 for nodes at rest.
    """

    place: Float[np.ndarray, " nodes"]
    weight: Float[np.ndarray, " nodes"]
    knot: Float[np.ndarray, "3 3 cells+1"]
    inner: Float[np.ndarray, "3 4 cells"]
    free: Float[np.ndarray, " cells+3"]
    standing: Float[np.ndarray, " nodes"]


def power_form(knots: Float[np.ndarray, " cells+1"]) -> Float[np.ndarray, "4 4 cells"]:
    """[p, k]: the contribution of coefficient k of a cell to the coefficient of zᵖ, where z in [0, 1] is the place.

    It is computed by the Cox–de Boor recursion, applied to polynomials in z.
    """
    cells = knots.size - 1
    t = np.concatenate([knots[:1].repeat(DEGREE), knots, knots[-1:].repeat(DEGREE)])
    start, length = knots[:-1], np.diff(knots)
    basis = [np.ones((1, cells))]
    for degree in range(1, DEGREE + 1):
        new = [np.zeros((degree + 1, cells)) for _ in range(degree + 1)]
        for k, lower in enumerate(basis):  # the function whose support ends k + 1 knots after the start of the cell
            left = t[np.arange(cells) + DEGREE + k + 1 - degree]
            right = t[np.arange(cells) + DEGREE + k + 1]
            span = right - left
            grows = np.stack([(start - left) / span, length / span])
            falls = np.stack([(right - start) / span, -length / span])
            for power in range(2):
                new[k][power : power + degree] += falls[power] * lower
                new[k + 1][power : power + degree] += grows[power] * lower
        basis = new
    return np.stack(basis, axis=1)


def nodes(knots: Float[np.ndarray, " cells+1"], rest: tuple[bool, bool]) -> Nodes:
    """The nodes; `rest` says whether the value vanishes at the start and at the end."""
    return _nodes(tuple(knots.tolist()), rest)


@functools.lru_cache(maxsize=32)
def _nodes(listed: tuple[float, ...], rest: tuple[bool, bool]) -> Nodes:
    knots = np.array(listed)
    length, cells = np.diff(knots), knots.size - 1
    inner, at_knots, inside = np.full(cells, 0.5), np.zeros(cells + 1), np.full(cells, 4.0)
    ends = np.ones((2, cells))
    for side, (is_at_rest, cell) in enumerate(zip(rest, (0, -1), strict=True)):
        if is_at_rest:
            inner[cell] = (REST_PLACE, 1 - REST_PLACE)[side]
            inside[cell], ends[:, cell] = 6 * REST_WEIGHT, 0.0
    at_knots[:-1] += length * ends[0] / 6
    at_knots[1:] += length * ends[1] / 6
    form = power_form(knots)
    first = _at(form, np.zeros(cells), length)[:, :3]
    last = _at(form[..., -1:], np.ones(1), length[-1:])[:, 1:]
    free, standing = np.ones(cells + DEGREE), np.zeros(2 * cells + 1)
    free[0], free[-1] = 1.0 - rest[0], 1.0 - rest[1]
    standing[0], standing[cells] = rest
    return Nodes(
        np.concatenate([knots, knots[:-1] + inner * length]),
        np.concatenate([at_knots, length * inside / 6]),
        np.concatenate([first, last], axis=-1),
        _at(form, inner, length),
        free,
        standing,
    )


def within(knots: Float[np.ndarray, " cells+1"], count: int) -> Float[np.ndarray, "count 3 4 cells"]:
    """The matrices from the coefficients of a cell to value and derivatives at equally spaced places, ends included."""
    length = np.diff(knots)
    form = power_form(knots)
    return np.stack([_at(form, np.full(length.size, z), length) for z in np.linspace(0.0, 1.0, count)])


def _at(form: Numbers, place: Numbers, length: Numbers) -> Float[np.ndarray, "3 4 cells"]:
    z, one = place, np.ones_like(place)
    powers = np.stack([[one, z, z**2, z**3], [0 * z, one, 2 * z, 3 * z**2], [0 * z, 0 * z, 2 * one, 6 * z]])
    return np.einsum("dpn,pkn->dkn", powers, form) / length ** np.arange(ORDERS)[:, None, None]


def local(coefficients: Float[Array, " cells+3"]) -> Float[Array, "4 cells"]:
    """The four coefficients of each cell."""
    cells = coefficients.shape[0] - DEGREE
    return jnp.stack([coefficients[k : k + cells] for k in range(DEGREE + 1)])


def at_nodes(n: Nodes, coefficients: Float[Array, " cells+3"]) -> Float[Array, "3 nodes"]:
    """Value and derivatives at the nodes."""
    near = local(coefficients)
    cells = near.shape[-1]
    knots = jnp.stack([coefficients[k : k + cells + 1] for k in range(DEGREE)])
    return jnp.concatenate([jnp.sum(n.knot * knots[None], axis=1), jnp.sum(n.inner * near[None], axis=1)], axis=-1)


def gathered(n: Nodes, parts: Float[Array, "3 nodes"]) -> Float[Array, " cells+3"]:
    """The gradient with respect to the coefficients, from that with respect to values and derivatives at the nodes."""
    knots = n.knot.shape[-1]
    families = ((n.knot, parts[:, None, :knots]), (n.inner, parts[:, None, knots:]))
    total: Array | float = 0.0
    for basis, part in families:
        own = jnp.sum(basis * part, axis=0)
        last = own.shape[0] - 1
        total = total + sum(jnp.pad(own[k], (k, last - k)) for k in range(last + 1))
    return total  # type: ignore[return-value]


def gathered_band(n: Nodes, parts: Float[Array, "3 3 nodes"]) -> Float[Array, "4 cells+3"]:
    """The same for second derivatives: the subdiagonals of a symmetric matrix, entry (i, i − d) at index i of row d."""
    knots = n.knot.shape[-1]
    rows: list[Array | float] = [0.0] * (DEGREE + 1)
    for basis, part in ((n.knot, parts[..., :knots]), (n.inner, parts[..., knots:])):
        half = jnp.sum(part[:, :, None] * basis[None], axis=1)  # (orders, coefficients, nodes)
        last = half.shape[1] - 1
        for below in range(last + 1):
            products = jnp.sum(basis[:, below:] * half[:, : last + 1 - below], axis=0)
            for k in range(below, last + 1):
                rows[below] = rows[below] + jnp.pad(products[k - below], (k, last - k))
    return jnp.stack(rows)  # type: ignore[arg-type]
