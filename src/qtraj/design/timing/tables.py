"""Tables for the search for a timing, which depend only on its cells."""

import functools
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.grid import Grid
from qtraj.design.timing.spline import DEGREE, Nodes, Within, nodes, power_form

CHECKED = 17
"""Number of points of each cell at which limits are checked after a search."""


class Tables(NamedTuple):
    """Data that depend only on the cells: the grid, its nodes, and the values of the spline within each cell.

    At a knot where the spline is less smooth, empty cells follow its cell; `filled` are the indices of all others. For
    each node, and then for each point at which limits are checked, `cell` is the index of its cell and `place` its
    position in the cell, between 0 and 1. `within` evaluates splines within cells.
    """

    grid: Grid
    nodes: Nodes
    cell: Int[Any, " all"]
    place: Float[Any, " all"]
    within: Within
    filled: Int[Any, " filled"]


def tables(
    grid: Grid,
    rest: tuple[bool, bool],
    lap: bool = False,
    smooth: Int[np.ndarray, " cells-1"] | None = None,
    held: tuple[bool, bool] = (False, False),
) -> Tables:
    """Return the tables of a grid.

    `rest` indicates whether the vehicle is at rest at the start and at the end, `held` at which ends u̇² has another
    fixed value, and `lap` whether the end of the path is its start. `smooth` is the order of the derivatives that are
    continuous at the knots between cells, by default 2.
    """
    orders = [DEGREE - 1] * (grid.cells - 1) if smooth is None else smooth.tolist()
    return _tables(tuple(tuple(x.tolist()) for x in grid), rest, lap, tuple(orders), held)


@functools.lru_cache(maxsize=4)
def _tables(fields: Any, rest: tuple[bool, bool], lap: bool, orders: Any, held: tuple[bool, bool]) -> Tables:
    filled, grid = _with_empty_cells(Grid(*(np.array(x) for x in fields)), DEGREE - np.array([*orders, DEGREE - 1]))
    knots, own, length = grid.knots, nodes(grid.knots, rest, lap, held), np.diff(grid.knots)
    columns = np.append(np.arange(length.size), length.size - 1)
    cell = np.concatenate([columns, columns, np.tile(np.arange(length.size), CHECKED)])
    span = np.where(length > 0, length, 1.0)[columns]
    at_nodes = ((own.place - knots[columns]) / span).ravel()
    place = np.concatenate([at_nodes, np.repeat(np.linspace(0.0, 1.0, CHECKED), length.size)])
    return Tables(grid, own, cell, place, Within(power_form(knots, lap), span[:-1]), filled)


def _with_empty_cells(grid: Grid, count: Int[np.ndarray, " cells"]) -> tuple[Int[np.ndarray, " cells"], Grid]:
    """Return the indices of the cells after the insertion of empty ones, and the cells with them.

    Each cell becomes `count` cells, of which the last ones are at the end of the cell and have no length.
    """
    filled = np.cumsum(count) - count
    knots = np.append(grid.knots[:1], np.repeat(grid.knots[1:], count))
    segment, middle, half = (np.repeat(x, count) for x in grid[1:])
    empty = np.ones(segment.size, bool)
    empty[filled] = False
    return filled, Grid(knots, segment, np.where(empty, middle + half, middle), np.where(empty, 0.0, half))
