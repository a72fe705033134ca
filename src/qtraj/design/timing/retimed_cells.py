"""Relate the cells of a retimed path to the segments of the original path, and evaluate the motion in them."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.grid import Grid, Shape, derivatives, uniform
from qtraj.design.timing.parts import Part, known_segments, standing_ends
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.arrays import is_traced
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

    For a path with one segment and traced knots, the result assumes cells of equal length. Check this assumption with
    `divides_equally`.
    """
    knots, count = path.timing.knots, path.timing.coefficients.shape[-2]
    if not isinstance(path.path, Route):
        if count & (count - 1):
            return None
        found = Cells(uniform(count), np.arange(count), np.zeros((2, count), bool))
        return found if is_traced(knots) or bool(np.all(divides_equally(path, found))) else None
    if path.duration.ndim or is_traced(path.path, knots):
        return None
    segments, at = known_segments(path.path), np.asarray(knots)
    starts, spans = segments.starts, segments.durations
    own = np.clip(np.searchsorted(starts, 0.5 * (at[1:] + at[:-1]), side="right") - 1, 0, starts.size - 1)
    half = np.exp2(np.round(np.log2(np.maximum(np.diff(at), 1e-300) / spans[own])))
    middle = (2 * np.round(((at[1:] + at[:-1] - 2 * starts[own]) / spans[own] / half - 1) / 2) + 1) * half - 1
    ends = starts[own] + 0.5 * spans[own] * (1 + middle + np.array([[-1.0], [1.0]]) * half)
    error = max(np.abs(ends - np.stack([at[:-1], at[1:]])).max(), abs(at[0]), abs(at[-1] - starts[-1] - spans[-1]))
    if error > ROUNDINGS * np.finfo(float).eps * (starts[-1] + spans[-1]):
        return None
    columns = np.flatnonzero(segments.coefficients[own, 1:].any(axis=(1, 2)))
    grid = Grid(np.arange(columns.size + 1.0), own[columns], middle[columns], half[columns])
    sides = np.stack([grid.middle - grid.half == -1, grid.middle + grid.half == 1])
    return Cells(grid, columns, sides & standing_ends(segments)[grid.segment].T) if columns.size else None


def divides_equally(path: RetimedPath, cells: Cells) -> Any:
    """Return whether the knots divide the whole path into cells of equal length, for each path of a batch."""
    xp: Any = jnp if is_traced(path) else np
    duration, knots = xp.asarray(path.path.duration)[..., None], xp.asarray(path.timing.knots)
    equal = (cells.grid.knots / cells.grid.cells).reshape(*[1] * (knots.ndim - 1), -1)
    error = xp.abs(knots - duration * equal)
    return xp.max(error / duration, axis=-1) <= ROUNDINGS * float(np.finfo(knots.dtype).eps)


def of_parts(parts: list[Part]) -> Cells:
    """Return the moving cells of all parts of a path; the single cell that a stop has in the timing is omitted."""
    columns, grids, stops, first = [], [], [], 0
    for part in parts:
        count = 1 if part.grid is None else part.grid.cells
        if part.grid is not None:
            columns.append(first + np.arange(count))
            grids.append(part.grid[1:])
            stops.append(np.zeros((2, count), bool))
            stops[-1][0, 0], stops[-1][1, -1] = part.stops
        first += count
    moving = np.concatenate(columns)
    grid = Grid(np.arange(moving.size + 1.0), *(np.concatenate(x) for x in zip(*grids, strict=True)))
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
