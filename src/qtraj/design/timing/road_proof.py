"""Prove limits on a timing on a road that changes along the way: on every cell, for all variants of the road."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.proof import MAX_WORK, prove
from qtraj.design.timing.road import ON_ROAD
from qtraj.design.timing.road_cells import variants
from qtraj.design.timing.sources import Source
from qtraj.path.quantity import quantity
from qtraj.path.road_on_path import RoadOnPath

HALVINGS = 6
"""How often a cell is halved in which a limit is not proved, because the variants are not close to the road."""

LITTLE_WORK = MAX_WORK // 64
"""The largest work for a claim in integers, if smaller cells make it easier."""

TIGHTER = 2.0**-50
"""Fraction of a linear limit that exceeds the rounding errors of its values inside a cell."""

Codes = Int[np.ndarray, "limits cells"]
Ends = tuple[Float[np.ndarray, " cells"], Float[np.ndarray, " cells"]]
"""The parameters of the path at the starts and at the ends of cells."""


def prove_on_road(
    path: Source,
    grid: Grid,
    timing: tuple[Float[Any, "cells 4"], Bool[Any, "2 *cells"]],
    bounds: Mapping[str, Any],
    on: RoadOnPath,
    ends: Ends,
    place: Float[np.ndarray, "2 cells"] | None = None,
) -> tuple[Codes, Bool[np.ndarray, " cells"]]:
    """Return the status of each limit on each cell, and where the variants of the road are not the road itself.

    A limit is PROVED if it is for all variants (see `road_cells`). Where these are not the road itself, limits on
    forces are UNDECIDED instead of BROKEN. The other arguments are those of `prove`.
    """
    found, count = variants(on, *ends), grid.cells
    powers, rest = timing
    if np.ndim(rest) == 1:
        rest, ends_at_rest = np.zeros((2, count), bool), rest
        rest[0, 0], rest[1, -1] = ends_at_rest
    place = np.stack([np.zeros(count), np.ones(count)]) if place is None else place
    others = {name: x for name, x in bounds.items() if name not in ON_ROAD}
    codes = np.array(prove(path, grid, (powers, rest), others, None, place).codes)
    of_road = {name: x for name, x in bounds.items() if name in ON_ROAD}
    rows = np.array([NAMES.index(name) for name in of_road], int)
    if not rows.size:
        return codes, found.rough
    codes[rows] = PROVED
    for some, work in ((found.rough, LITTLE_WORK), (~found.rough, MAX_WORK)):
        k = np.flatnonzero(some)
        if not k.size:
            continue
        part = Grid(np.arange(k.size + 1.0), *(x[k] for x in grid[1:]))
        own = {name: np.asarray(x)[k] if np.ndim(x) else x for name, x in of_road.items()}
        for start, end in found.ends if some is found.rough else found.ends[:1]:
            road = [x.each(lambda y, k=k: np.asarray(y)[k]) for x in (start, end)]
            new = prove(path, part, (powers[k], rest[:, k]), own, road[0], place[:, k], road[1], work).codes
            new = np.asarray(new)[rows]
            before = codes[np.ix_(rows, k)]
            codes[np.ix_(rows, k)] = np.where(new == PROVED, before, new)
    own_codes = codes[rows]
    codes[rows] = np.where(found.rough & (own_codes == BROKEN), UNDECIDED, own_codes)
    return codes, found.rough


def proved_on_road(
    path: Source,
    grid: Grid,
    timing: tuple[Float[np.ndarray, "cells 4"], Bool[np.ndarray, " 2"]],
    bounds: Mapping[str, Any],
    on: RoadOnPath,
    ends: Ends,
) -> Codes:
    """Return the status of each limit on each cell; cells are halved for limits on forces."""
    powers, rest = timing
    codes, rough = prove_on_road(path, grid, timing, bounds, on, ends)
    for name in (name for name in ON_ROAD if name in bounds):
        row = NAMES.index(name)
        cell = np.flatnonzero(rough & (codes[row] != PROVED))
        open_cells, start, end = cell, np.zeros(cell.size), np.ones(cell.size)
        failed = np.zeros(grid.cells, bool)
        for _ in range(HALVINGS):
            if not cell.size:
                break
            cell, start, end = np.repeat(cell, 2), np.repeat(start, 2), np.repeat(end, 2)
            end[::2] = start[1::2] = 0.5 * (start[::2] + end[::2])
            at_rest = np.zeros((2, cell.size), bool)
            at_rest[0] = rest[0] & (cell == 0) & (start == 0)
            at_rest[1] = rest[1] & (cell == grid.cells - 1) & (end == 1)
            low, high = (ends[0][cell] + x * (ends[1] - ends[0])[cell] for x in (start, end))
            own = {name: _in_parts(bounds[name], quantity(name).side, cell, start, end)}
            parts, place = part_of_grid(grid, cell, start, end), np.stack([start, end])
            found = prove_on_road(path, parts, (powers[cell], at_rest), own, on, (low, high), place)[0][row]
            left = found != PROVED
            cell, start, end = cell[left], start[left], end[left]
        failed[cell] = True
        codes[row, open_cells[~failed[open_cells]]] = PROVED
    return codes


def part_of_grid(grid: Grid, cell: np.ndarray, start: np.ndarray, end: np.ndarray) -> Grid:
    """Return parts of cells, from `start` to `end` as dyadic fractions, as a grid."""
    half = grid.half[cell] * (end - start)
    middle = grid.middle[cell] + grid.half[cell] * (start + end - 1)
    return Grid(np.arange(half.size + 1.0), grid.segment[cell], middle, half)


def _in_parts(bound: Any, side: int, cell: np.ndarray, start: np.ndarray, end: np.ndarray) -> Any:
    """Return a limit on a force in parts of cells; a linear one is nowhere less strict than in its cell."""
    if np.ndim(bound) != 2:
        return bound
    first, last = np.asarray(bound)[cell].T
    rounding = side * TIGHTER * np.maximum(np.abs(first), np.abs(last))
    return np.stack([first + x * (last - first) - rounding for x in (start, end)], axis=1)
