"""Prove by how much a timing that another program computed exceeds the limits, with the proof of `retime`.

The other program returns u̇² as a polynomial of degree 3 or less in each cell of the grid that `retime` uses on the same
path. The proof considers every point of a cell, so the result does not depend on samples.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

import qtraj as qt
from qtraj.design.proof.certificate import BROKEN, PROVED
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.grid import Grid, of_segments, uniform
from qtraj.design.timing.proof import prove
from qtraj.design.timing.sources import Source, source

SMALLEST, LARGEST, RATIO = 1e-12, 1e3, 1.01
"""Range of the relative excess that the bisection considers, and the ratio of its final bounds."""


class Cells(NamedTuple):
    """The polynomials of a path without stops, the cells that `retime` uses, and their knots (cells + 1,) [s]."""

    polynomials: Source
    grid: Grid
    knots: np.ndarray


def cells_of(path, cells: int) -> Cells:
    """Return at least `cells` cells of a path without stops."""
    polynomials = source(path)
    assert polynomials is not None
    if isinstance(path, qt.Route):
        starts = np.asarray(path.times, float)
        grid = of_segments(starts, 0, cells, (False, False))
    else:
        grid = uniform(cells)
    return Cells(polynomials, grid, grid.knots * (float(path.duration) / grid.cells))


def exceeded(cells: Cells, powers: np.ndarray, rest: tuple[bool, bool], limits: qt.Limits) -> dict:
    """Return the status of each limit, and the smallest e for which limit·(1 + e) is proved to be satisfied.

    `powers` (cells, 4) are the coefficients of u̇² for ascending powers of the position in a cell, from 0 to 1. `rest`
    is whether u̇² is zero at the start and at the end. e is 0 for a limit that is proved, and otherwise at most 1 %
    larger than the smallest excess that can be proved; it is infinite if nothing can be proved.
    """
    given = limits.given()
    names = [name for name in NAMES if name in given]
    values = np.array([float(given[name]) for name in names])

    def codes(excess):
        bounds = {name: jnp.asarray(x) for name, x in zip(names, values * (1 + excess), strict=True)}
        own = np.asarray(prove(cells.polynomials, cells.grid, (jnp.asarray(powers), np.array(rest)), bounds).whole())
        return own[[NAMES.index(name) for name in names]]

    first, proved = codes(0.0), codes(LARGEST) == PROVED
    low, high = np.full(values.size, SMALLEST), np.full(values.size, LARGEST)
    while np.max(high / low) > RATIO:
        middle = np.sqrt(low * high)
        satisfied = codes(middle) == PROVED
        low, high = np.where(satisfied, low, middle), np.where(satisfied, middle, high)
    excess = np.where(first == PROVED, 0.0, np.where(proved, high, np.inf))
    status = {PROVED: "proved", BROKEN: "broken"}
    return {name: (status.get(c, "undecided"), float(e)) for name, c, e in zip(names, first, excess, strict=True)}
