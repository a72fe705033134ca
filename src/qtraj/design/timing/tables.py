"""Tables for the search for a timing, which depend only on its cells."""

import functools
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.grid import Grid
from qtraj.design.timing.spline import Nodes, nodes, power_form, within

CHECKED = 17
"""Number of points of each cell at which limits are checked after a search."""


class Tables(NamedTuple):
    """Data that depend only on the cells: the grid, its nodes, and the values of the spline within each cell.

    For each node, and then for each point at which limits are checked, `cell` is the index of its cell and `place` its
    position in the cell, between 0 and 1. `within` and `powers` are the results of the functions `within` and
    `power_form` of the module `spline`.
    """

    grid: Grid
    nodes: Nodes
    cell: Int[Any, " all"]
    place: Float[Any, " all"]
    within: Float[Any, "places 3 4 cells"]
    powers: Float[Any, "4 4 cells"]


def tables(grid: Grid, rest: tuple[bool, bool], jerk: bool = False, lap: bool = False) -> Tables:
    """Return the tables of a grid.

    `rest` indicates whether the vehicle is at rest at the start and at the end, and `jerk` whether the jerk is limited.
    The jerk may jump where one segment ends and the next one starts, so nodes are placed on both sides of this knot.
    `lap` indicates whether the end of the path is its start.
    """
    return _tables(tuple(tuple(x.tolist()) for x in grid), rest, jerk, lap)


@functools.lru_cache(maxsize=32)
def _tables(fields: tuple[tuple[float, ...], ...], rest: tuple[bool, bool], jerk: bool, lap: bool) -> Tables:
    knots, segment, middle, half = (np.array(x) for x in fields)
    jumps = np.append(np.diff(segment) != 0, False) if jerk else None
    grid, own, length = Grid(knots, segment, middle, half), nodes(knots, rest, jumps, lap), np.diff(knots)
    columns = np.append(np.arange(length.size), length.size - 1)
    cell = np.concatenate([columns, columns, np.tile(np.arange(length.size), CHECKED)])
    at_nodes = ((own.place - knots[columns]) / length[columns]).ravel()
    place = np.concatenate([at_nodes, np.repeat(np.linspace(0.0, 1.0, CHECKED), length.size)])
    return Tables(grid, own, cell, place, within(knots, CHECKED, lap), power_form(knots, lap))
