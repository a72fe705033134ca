"""The cells of a timing: dyadic parts of the segments of a path, so that the change of variable to a cell is exact."""

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


class Grid(NamedTuple):
    """n cells. Cell j is the interval `middle` ± `half` of [−1, 1], the range of s on the segment with index `segment`.

    `knots` (n + 1,) from 0 to n are the ends of the cells in units of their mean length. `half` is a power of two.
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
    """A part of a path that starts at the parameter `start` and has cells of the mean length `per_cell`."""

    path: AbstractHodograph
    start: Scalar
    per_cell: Scalar


def uniform(cells: int) -> Grid:
    """Cells of equal length on a path with one segment; `cells` is a power of two."""
    k = np.arange(cells)
    return Grid(np.arange(cells + 1.0), np.zeros(cells, int), (2 * k + 1) / cells - 1, np.full(cells, 1 / cells))


def of_segments(starts: Float[np.ndarray, " n+1"], first: int, cells: int) -> Grid:
    """Cells of n segments with indices from `first` on: the longest cell is halved until there are enough.

    Each segment has at least one cell. `starts` (n + 1,): the parameters of the starts, and of the last end.
    """
    lengths = np.diff(starts)
    queue = [(-h, i, 0.0, 1.0) for i, h in enumerate(lengths)]
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
    """r', r'' and r''' in world axes at the fraction `place` of each cell; at a knot, from the side of that cell."""
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
