"""Divide segments into cells for a timing; cells are dyadic parts, so the change of variable to a cell is exact."""

import heapq
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra.polynomial import taylor_terms
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.types import Scalar
from qtraj.path import pieces, progress
from qtraj.path.components import rotated_z
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import in_moving_basis
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

    knots: Float[Any, " cells+1"]
    segment: Int[Any, " cells"]
    middle: Float[Any, " cells"]
    half: Float[Any, " cells"]

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


def of_segments(starts: Float[Any, " n+1"], first: int, cells: int, stops: tuple[bool, bool]) -> Grid:
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


def ends(path: AbstractHodograph, grid: Grid) -> tuple[Float[np.ndarray, " cells"], Float[np.ndarray, " cells"]]:
    """Return the parameters of a path with concrete values at the starts and at the ends of the cells."""
    starts = np.asarray(path.starts) if isinstance(path, Route) else np.zeros(1)
    spans = np.asarray(pieces.durations(starts, np.asarray(path.duration)))
    low, high = (
        starts[grid.segment] + 0.5 * spans[grid.segment] * (1 + grid.middle + side * grid.half) for side in (-1, 1)
    )
    return low, high


def derivatives(shape: Shape, grid: Grid, cell: Int[Any, " m"], place: Float[Any, " m"]) -> Float[Any, "{ORDER} 3 m"]:
    """Return r', r'' and r''' in world axes at the fraction `place` of each `cell`; one-sided at the ends of a cell.

    The axes of the result are the order of the derivative, the component and the point. The result is a NumPy array
    unless the path or the other arguments are traced.
    """
    xp: Any = jnp if is_traced(shape, cell, place) else np
    path = shape.path
    if isinstance(path, Route):
        segment, middle, half = (xp.asarray(x)[cell] for x in grid[1:])
        starts, duration = (xp.asarray(x) for x in (path.starts, path.duration))
        span = pieces.durations(starts, duration)[segment]
        return _of_route(xp, path, segment, 0.5 * span * (1 + middle + half * (2 * place - 1)))
    knots = xp.asarray(grid.knots)
    x = knots[cell] + place * (knots[cell + 1] - knots[cell])
    return path_derivatives(path, shape.start + x * shape.per_cell)


def path_derivatives(path: AbstractHodograph, u: Float[Any, " m"]) -> Float[Any, "{ORDER} 3 m"]:
    """Return r', r'' and r''' of a path in world axes at the parameters `u`, as a NumPy array unless it is traced."""
    traced = is_traced(path, u)
    xp: Any = jnp if traced else np
    polynomials = path.polynomials()
    if isinstance(path, Route):
        starts = xp.asarray(path.starts)
        i = xp.maximum(xp.searchsorted(starts, u, side="right") - 1, 0)
        return _of_route(xp, path, i, u - starts[i])
    if polynomials is None:
        size = u.size if traced else 1 << (u.size - 1).bit_length()  # few sizes are compiled
        rows = _of_any_path(path, u if traced else np.pad(np.asarray(u), (0, size - u.size), mode="edge"))
        return xp.moveaxis(xp.asarray(rows)[: u.size], 0, 2)
    p = polynomials if traced else jax.tree.map(np.asarray, polynomials)
    series = [
        [0] * (ORDER + 1) if c is None else taylor_terms([c[k] for k in range(c.shape[0])], u, ORDER)
        for c in (p.x, p.y, p.z, p.angle)
    ]
    angle = u * 0.0 + series[-1][0]
    cos, sin = xp.cos(angle), xp.sin(angle)
    rows = [rotated_z(row, cos, sin) for row in in_moving_basis(*series)[1:]]
    local = xp.stack([xp.stack([x + 0.0 * u for x in row]) for row in rows])
    if p.placement is None:
        return local
    columns = [xp.asarray(polynomials.placement.to_world(axis)) for axis in np.eye(3)]  # type: ignore[union-attr]
    return xp.einsum("jx,kjm->kxm", xp.stack(columns), local)


def _of_route(xp: Any, route: Route, i: Int[Any, " m"], local: Float[Any, " m"]) -> Float[Any, "{ORDER} 3 m"]:
    """Return the derivatives of a route in the segments `i`, at times `local` since their starts."""
    own = route.progress
    if xp is np and own is None:
        return pieces.derivatives(np.asarray(route.coefficients), i, local, ORDER)
    c = pieces.chosen(xp.asarray(route.coefficients), i)
    rows = pieces.values(c, local, ORDER) if own is None else progress.values(c, xp.asarray(own)[i], local, ORDER)
    return xp.moveaxis(xp.stack(rows[1:]), 1, 2)


@eqx.filter_jit
def _of_any_path(path: AbstractHodograph, u: Float[Any, " m"]) -> Float[Any, "m {ORDER} 3"]:
    return jax.vmap(lambda x: path.derivatives(x, ORDER)[1:])(u)
