"""Divide segments into cells for a timing; cells are dyadic parts, so the change of variable to a cell is exact."""

import heapq
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.types import Scalar
from qtraj.path import pieces
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route

ORDER = 3
"""The highest derivative of a path that a limit needs."""

FINER = 8.0
"""Factor on the number of cells of a segment that starts or ends at a stop, where u̇² and the jerk change quickly."""


class Grid(NamedTuple):
    """The n cells of a timing: cell j is the interval `middle` ± `half` of the variable s of its segment, −1 ≤ s ≤ 1.

    `segment` (n,) are the indices of the segments. `knots` (n + 1,) from 0 to n are the ends of the cells in units of
    their mean length. Each `half` is a power of two.
    """

    knots: Float[np.ndarray, " cells+1"]
    segment: Int[np.ndarray, " cells"]
    middle: Float[np.ndarray, " cells"]
    half: Float[np.ndarray, " cells"]

    @property
    def cells(self) -> int:
        """The number of cells."""
        return self.segment.size


class Shape(NamedTuple):
    """A part of a path that starts at the parameter `start` [s] and has cells of the mean length `per_cell` [s]."""

    path: AbstractHodograph
    start: Scalar
    per_cell: Scalar


def uniform(cells: int) -> Grid:
    """Return cells of equal length on a path with one segment; `cells` is a power of two."""
    k = np.arange(cells)
    return Grid(np.arange(cells + 1.0), np.zeros(cells, int), (2 * k + 1) / cells - 1, np.full(cells, 1 / cells))


def of_segments(starts: Float[np.ndarray, " n+1"], first: int, cells: int, stops: tuple[bool, bool]) -> Grid:
    """Return at least `cells` cells of n segments, whose indices start at `first`.

    Initially each segment is one cell. Then the longest cell is halved repeatedly until there are enough cells. In this
    comparison, lengths in a segment next to a stop are multiplied by `FINER`. `starts` (n + 1,) are the parameters at
    the starts of the segments and at the end of the last one. `stops` indicates whether the velocity is zero at the
    start and at the end.
    """
    lengths = np.diff(starts)
    weights = np.ones(lengths.size)
    weights[[k for k, stop in zip((0, -1), stops, strict=True) if stop]] = FINER
    queue = [(-h, i, 0.0, 1.0) for i, h in enumerate(weights * lengths)]
    heapq.heapify(queue)
    while len(queue) < cells:
        length, i, middle, half = heapq.heappop(queue)
        for side in (-0.5, 0.5):
            heapq.heappush(queue, (0.5 * length, i, middle + side * half, 0.5 * half))
    rows = sorted((i, middle, half) for _, i, middle, half in queue)
    segment, middle, half = (np.array(x) for x in zip(*rows, strict=True))
    at = starts[segment] + 0.5 * (middle - half + 1) * lengths[segment]
    knots = (np.append(at, starts[-1]) - starts[0]) * (len(rows) / (starts[-1] - starts[0]))
    return Grid(knots, segment.astype(int) + first, middle, half)


def derivatives(shape: Shape, grid: Grid, cell: Int[Any, " m"], place: Float[Any, " m"]) -> Float[Array, "{ORDER} 3 m"]:
    """Return r', r'' and r''' in world axes at the fraction `place` of each `cell`; one-sided at the ends of a cell.

    The axes of the result are the order of the derivative, the component and the point.
    """
    path, dtype = shape.path, shape.per_cell.dtype
    if isinstance(path, Route):
        segment, middle, half = (jnp.asarray(x)[cell] for x in grid[1:])
        span = pieces.durations(path.starts, path.duration)[segment]
        local = 0.5 * span * (1 + middle + half * (2 * jnp.asarray(place, dtype) - 1))
        rows = pieces.values(path.coefficients[segment], local, ORDER)
        return jnp.moveaxis(jnp.stack(rows[1:]), 1, 2)
    knots = jnp.asarray(grid.knots, dtype)
    x = knots[cell] + place * (knots[cell + 1] - knots[cell])
    rows = jax.vmap(lambda u: path.derivatives(u, ORDER)[1:])(shape.start + x * shape.per_cell)
    return jnp.moveaxis(rows, 0, 2)
