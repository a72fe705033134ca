"""Relate the cells of a retimed path to the segments of the original path, and evaluate the motion in them."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.grid import Grid, Shape, derivatives, uniform
from qtraj.design.timing.parts import known_segments, standing_ends
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.arrays import constants, is_traced
from qtraj.path.route import Route

ROUNDINGS = 64
"""Largest accepted distance between a knot and the end of a dyadic cell.

The unit is the machine epsilon times the duration of the path.
"""


class Cells(NamedTuple):
    """The cells of a timing in which the vehicle moves.

    `grid` contains the cells as dyadic parts of segments, `columns` are their indices among all cells of the timing,
    and `stops` (2, cells) indicates whether the velocity of the path is zero at the start and at the end of a cell.
    """

    grid: Grid
    columns: Int[Any, " cells"]
    stops: Any


def cells_of(path: RetimedPath) -> Cells | None:
    """Return the cells of the timing, or None if they are not dyadic parts of the segments of the original path.

    For a path with one segment that is traced or a batch, the result assumes cells of equal length. If the knots are
    traced, check this assumption with `divides_equally`.
    """
    if not isinstance(path.path, Route):
        path = constants(path)  # known under grad
    knots, count = path.timing.knots, path.timing.coefficients.shape[-2]
    if path.duration.ndim or is_traced(path.path, knots):
        if isinstance(path.path, Route) or count & (count - 1):
            return None
        found = Cells(uniform(count), np.arange(count), np.zeros((2, count), bool))
        return found if is_traced(knots) or bool(np.all(divides_equally(path, found))) else None
    if not isinstance(path.path, Route):
        grid = _dyadic(np.asarray(knots), np.zeros(1), np.asarray(path.path.duration)[None])
        return None if grid is None else Cells(grid, np.arange(count), np.zeros((2, count), bool))
    segments = known_segments(path.path)
    grid = _dyadic(np.asarray(knots), segments.starts, segments.durations)
    if grid is None:
        return None
    columns = np.flatnonzero(segments.coefficients[grid.segment, 1:].any(axis=(1, 2)))
    grid = Grid(np.arange(columns.size + 1.0), *(x[columns] for x in grid[1:]))
    sides = np.stack([grid.middle - grid.half == -1, grid.middle + grid.half == 1])
    return Cells(grid, columns, sides & standing_ends(segments)[grid.segment].T) if columns.size else None


def _dyadic(
    at: Float[np.ndarray, " cells+1"], starts: Float[np.ndarray, " n"], spans: Float[np.ndarray, " n"]
) -> Grid | None:
    """Return the cells between the knots `at` as dyadic parts of segments, or None if they are not such parts."""
    own = np.clip(np.searchsorted(starts, 0.5 * (at[1:] + at[:-1]), side="right") - 1, 0, starts.size - 1)
    half = np.exp2(np.round(np.log2(np.maximum(np.diff(at), 1e-300) / spans[own])))
    middle = (2 * np.round(((at[1:] + at[:-1] - 2 * starts[own]) / spans[own] / half - 1) / 2) + 1) * half - 1
    ends = starts[own] + 0.5 * spans[own] * (1 + middle + np.array([[-1.0], [1.0]]) * half)
    error = max(np.abs(ends - np.stack([at[:-1], at[1:]])).max(), abs(at[0]), abs(at[-1] - starts[-1] - spans[-1]))
    if error > ROUNDINGS * np.finfo(float).eps * (starts[-1] + spans[-1]):
        return None
    return Grid(np.arange(own.size + 1.0), own, middle, half)


def divides_equally(path: RetimedPath, cells: Cells) -> Any:
    """Return whether the knots divide the whole path into cells of equal length, for each path of a batch."""
    xp: Any = jnp if is_traced(path) else np
    duration, knots = xp.asarray(path.path.duration)[..., None], xp.asarray(path.timing.knots)
    equal = (cells.grid.knots / cells.grid.cells).reshape(*[1] * (knots.ndim - 1), -1)
    error = xp.abs(knots - duration * equal)
    return xp.max(error / duration, axis=-1) <= ROUNDINGS * float(np.finfo(knots.dtype).eps)


def of_parts(grids: list[Grid | None], ends: list[tuple[bool, bool]]) -> Cells:
    """Return the moving cells of all parts of a path; the grid of a stop is None, which has one cell in the timing.

    `ends` indicates for each part whether the velocity of the path is zero at its start and at its end.
    """
    columns, stops, first = [], [], 0
    for grid, own in zip(grids, ends, strict=True):
        count = 1 if grid is None else grid.cells
        if grid is not None:
            columns.append(first + np.arange(count))
            stops.append(np.zeros((2, count), bool))
            stops[-1][0, 0], stops[-1][1, -1] = own
        first += count
    moving = np.concatenate(columns)
    fields = zip(*(grid[1:] for grid in grids if grid is not None), strict=True)
    grid = Grid(np.arange(moving.size + 1.0), *(np.concatenate(x) for x in fields))
    return Cells(grid, moving, np.concatenate(stops, axis=1))


def motion_at(
    path: RetimedPath, cells: Cells, cell: Int[Any, " m"], place: Float[Any, " m"]
) -> tuple[Float[Any, "3 3 m"], Float[Any, "3 m"]]:
    """Return (r', r'', r''') and (a, a', a'') at the fraction `place` of each moving `cell`; one-sided at its ends.

    A prime denotes the derivative with respect to the path parameter u, and a = u̇². The axes of the first result are
    the order of the derivative, the component and the point.
    """
    xp: Any = jnp if is_traced(path, cell, place) else np
    timing = path.timing
    coefficients, knots = xp.asarray(timing.coefficients), xp.asarray(timing.knots)
    at = xp.asarray(cells.columns)[cell]
    grid = cells.grid if isinstance(path.path, Route) else cells.grid._replace(knots=knots)
    length = knots[at + 1] - knots[at]
    r = derivatives(Shape(path.path, xp.zeros(()), xp.ones(())), grid, cell, place)
    c = xp.moveaxis(coefficients[at], -1, 0)
    a = c[0] + place * (c[1] + place * (c[2] + place * c[3]))
    slope, bend = c[1] + place * (2 * c[2] + 3 * place * c[3]), 2 * c[2] + 6 * place * c[3]
    return r, xp.stack([a, slope / length, bend / length**2])
