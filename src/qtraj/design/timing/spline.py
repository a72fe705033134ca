"""Uniform clamped cubic splines on [0, 1]: values at nodes in each cell from the coefficients, and the power form.

A spline of n cells has n + 3 coefficients and is twice continuously differentiable. Cell j depends on coefficients j to
j + 3 alone, so every system of equations for them has a band of width three beside the diagonal.
"""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import BSpline

DEGREE = 3

LOBATTO = (np.array([-1.0, -(5**-0.5), 5**-0.5, 1.0]), np.array([1.0, 5.0, 5.0, 1.0]) / 6)
"""Nodes and weights on [−1, 1]; both ends are nodes, at which limits are imposed too."""

LEGENDRE = np.polynomial.legendre.leggauss(4)
"""Nodes inside, for a cell in which the vehicle stands at one end: they are spread over the square root of the way."""


class Nodes(NamedTuple):
    """Nodes of each cell.

    `place` in [0, 1] within the cell; `weight` of the integral over the cell, in cells; `basis` takes the four
    coefficients of a cell to the value and the first and second derivative at its nodes, per cell and per cell². `free`
    is 1 for coefficients that may change, and 0 for those of an end at rest.
    """

    place: Float[np.ndarray, "cells nodes"]
    weight: Float[np.ndarray, "cells nodes"]
    basis: Float[np.ndarray, "cells nodes 3 4"]
    free: Float[np.ndarray, "cells+3"]


def clamped(cells: int) -> Float[np.ndarray, " cells+7"]:
    """The knots, in cells; the ends are fourfold."""
    return np.concatenate([np.zeros(DEGREE), np.linspace(0.0, cells, cells + 1), np.full(DEGREE, float(cells))])


@functools.lru_cache(maxsize=16)
def power_form(cells: int) -> Float[np.ndarray, "cells 4 4"]:
    """For each cell the matrix from its four coefficients to ascending powers of the place in [0, 1] in the cell."""
    knots = clamped(cells)
    matrices = np.zeros((cells, DEGREE + 1, DEGREE + 1))
    left = np.arange(cells, dtype=float)
    for k in range(cells + DEGREE):
        unit = BSpline(knots, np.eye(1, cells + DEGREE, k)[0], DEGREE)
        near = np.arange(max(0, k - DEGREE), min(cells, k + 1))
        factorial = 1.0
        for power in range(DEGREE + 1):
            factorial *= max(power, 1)
            matrices[near, power, k - near] = unit(left[near], nu=power) / factorial
    return matrices


@functools.lru_cache(maxsize=32)
def nodes(cells: int, rest: tuple[bool, bool]) -> Nodes:
    """The nodes of a spline of n cells; `rest` says whether the value vanishes at the start and at the end."""
    place = np.broadcast_to((LOBATTO[0] + 1) / 2, (cells, 4)).copy()
    weight = np.broadcast_to(LOBATTO[1] / 2, (cells, 4)).copy()
    root, part = (LEGENDRE[0] + 1) / 2, LEGENDRE[1] / 2
    if rest[0]:
        place[0], weight[0] = root**2, 2 * root * part
    if rest[1]:
        place[-1], weight[-1] = 1 - root[::-1] ** 2, (2 * root * part)[::-1]
    free = np.ones(cells + DEGREE)
    free[0], free[-1] = 1.0 - rest[0], 1.0 - rest[1]
    return Nodes(place, weight, _basis(cells, place), free)


@functools.lru_cache(maxsize=16)
def within(cells: int, count: int) -> Nodes:
    """Equally spaced places in each cell, both ends among them, without weights."""
    place = np.broadcast_to(np.linspace(0.0, 1.0, count), (cells, count))
    return Nodes(place, np.zeros_like(place), _basis(cells, place), np.ones(cells + DEGREE))


def _basis(cells: int, place: Float[np.ndarray, "cells nodes"]) -> Float[np.ndarray, "cells nodes 3 4"]:
    powers = np.stack(
        [
            np.stack([np.ones_like(place), place, place**2, place**3], -1),
            np.stack([np.zeros_like(place), np.ones_like(place), 2 * place, 3 * place**2], -1),
            np.stack([np.zeros_like(place), np.zeros_like(place), 2 * np.ones_like(place), 6 * place], -1),
        ],
        axis=2,
    )
    return np.einsum("cndp,cpk->cndk", powers, power_form(cells))


def local(coefficients: Float[Array, "cells+3"]) -> Float[Array, "cells 4"]:
    """The four coefficients of each cell."""
    cells = coefficients.shape[0] - DEGREE
    return jnp.stack([coefficients[k : k + cells] for k in range(DEGREE + 1)], axis=1)


def assembled(parts: Float[Array, "cells 4"]) -> Float[Array, "cells+3"]:
    """The transpose of `local`: sums over the cells that share a coefficient."""
    return sum(jnp.pad(parts[:, k], (k, DEGREE - k)) for k in range(DEGREE + 1))  # type: ignore[return-value]


def assembled_band(parts: Float[Array, "cells 4 4"]) -> Float[Array, "4 cells+3"]:
    """The symmetric matrix of the sum over cells, by diagonals: row d holds entries (i, i − d) at place i."""
    rows = []
    for below in range(DEGREE + 1):
        entries = [(i, parts[:, i, i - below]) for i in range(below, DEGREE + 1)]
        rows.append(sum(jnp.pad(x, (i, DEGREE - i)) for i, x in entries))
    return jnp.stack(rows)
