"""Start a timing above its limits: brake as strongly as the longitudinal acceleration may, to the fastest timing.

Let w be the squared speed, s the distance along the path, and A the limit. From the speed v the vehicle reaches at
least w = v² − 2As. The fastest timing for a free start loses at most as much, so both curves meet once. From there on,
the fastest timing satisfies every limit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.proof.certificate import PROVED, SAMPLED
from qtraj.design.timing.cells import Cells, Shape
from qtraj.design.timing.constraint_values import ratios, used
from qtraj.design.timing.constraints import NAMES, listed, parts
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.part_search import Posed, shape_of
from qtraj.design.timing.part_timing import TimedPart, codes_of
from qtraj.design.timing.parts import Part
from qtraj.design.timing.road_cells import at_parameters
from qtraj.design.timing.search import MARGIN
from qtraj.design.timing.timing import Timing
from qtraj.design.varying import at_places, in_cells, strictest
from qtraj.foundation.arrays import is_traced
from qtraj.path.quantity import quantity

LIMITS = ("longitudinal_acceleration", "longitudinal_acceleration_min")
"""The limits that bound the deceleration."""

RESERVE = 1e-3
"""Fraction by which the deceleration stays below its limit, for the error of the cubics."""

MEETING, HALVINGS = 10, 12
"""How often the cell in which both curves meet is halved, and the largest number of halvings for the cubics."""

CHECKED = 17
"""Number of points of each cell at which quantities are compared with their limits."""


class Braked(NamedTuple):
    """A timing of the first part of a path that starts with braking, its cells, and the braking itself.

    The vehicle brakes until `time` [s] and `distance` [m]. `holds` is whether every limit is
    satisfied from there on.
    """

    timed: TimedPart
    grid: Grid
    time: float
    distance: float
    holds: bool


class _Pieces(NamedTuple):
    """Cells with the coefficients of u̇², and the usage and the status of the limits in them."""

    cells: Cells
    powers: Float[np.ndarray, "cells 4"]
    usage: Float[np.ndarray, "limits cells"]
    codes: Int[np.ndarray, "limits cells"]

    def halved(self, k: int) -> _Pieces:
        """Return the same timing with cell `k` divided into two; usage and status are those of the whole cell."""
        which = np.arange(len(self.powers)) == k
        first = self.powers[k] * 0.5 ** np.arange(4)
        c0, c1, c2, c3 = first
        second = np.array([c0 + c1 + c2 + c3, c1 + 2 * c2 + 3 * c3, c2 + 3 * c3, c3])
        powers = np.concatenate([self.powers[:k], [first, second], self.powers[k + 1 :]])
        usage, codes = (np.repeat(x, 1 + which, axis=1) for x in (self.usage, self.codes))
        return _Pieces(self.cells.halved(which), powers, usage, codes)


def braked(p: Posed, part: Part, found: tuple[TimedPart, Grid | None], speed: Any) -> Braked | None:
    """Return the timing that starts with `speed` [m/s] and brakes, or None if the limits do not tell how it brakes.

    `found` is the timing of the first part of the path from the highest speed within the limits. Without a limit on the
    longitudinal acceleration, braking is unbounded. With a limit on the jerk, braking would have to end gradually. The
    result is also None if the vehicle is still too fast at the end of the part, or if an argument is traced.
    """
    timed, grid = found
    limit = next((name for name in LIMITS if name in p.bounds), None)
    if grid is None or is_traced(p.path, p.bounds, p.vehicle, speed) or limit is None or "jerk" in p.bounds:
        return None
    shape = shape_of(p.path, part)
    cells = Cells(grid.segment - part.first, grid.middle, grid.half)
    pieces = _Pieces(cells, *(np.asarray(x) for x in (timed.powers, timed.usage, timed.codes)))
    start, strongest = float(speed) ** 2, (1 - RESERVE) * -_lowest(limit, strictest(p.bounds))
    if not strongest > 0:
        return None
    met = _meeting(shape, pieces, start, strongest)
    for _ in range(MEETING):
        if met is None:
            return None
        pieces = pieces.halved(met[0] - 1)
        met = _meeting(shape, pieces, start, strongest)
    if met is None:
        return None
    k, deceleration = met
    head = _slowed(p, shape, _chosen(pieces.cells, slice(k)), start, deceleration, limit)
    return None if head is None else _joined(p, part, timed, (head, pieces, k), shape)


def _meeting(shape: Shape, x: _Pieces, start: float, strongest: float) -> tuple[int, float] | None:
    """Return the first knot at which a vehicle with the squared speed `start` can be slow enough, and its deceleration.

    The deceleration [m/s²] is the one with which it has the speed of the timing `x` there. None means that there is no
    such knot, or only one at rest.
    """
    within, place = _squared_speeds(shape, x), _distances(shape, x.cells)
    k = int(np.argmax(within >= start - 2 * strongest * place))
    return (k, float((start - within[k]) / (2 * place[k]))) if k > 0 and within[k] > 0 else None


def _lowest(limit: str, bounds: Any) -> float:
    """Return the lower bound on the acceleration along the path."""
    return quantity(limit).side * -float(bounds[limit])


def _chosen(cells: Cells, which: slice) -> Cells:
    return Cells(*(x[which] for x in cells))


def _squared_speeds(shape: Shape, x: _Pieces) -> Float[np.ndarray, " cells+1"]:
    """Return the squared speeds at the knots."""
    r1 = shape.derivatives(*x.cells.places(2))[0]
    square = np.sum(r1 * r1, axis=0)
    return np.append(x.powers[:, 0] * square[:, 0], x.powers[-1].sum() * square[-1, 1])


def _distances(shape: Shape, cells: Cells) -> Float[np.ndarray, " cells+1"]:
    """Return the distances of the knots from the start [m]."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    place = cells.middle[:, None] + cells.half[:, None] * nodes
    r1 = shape.derivatives(cells.segment[:, None] + np.zeros(nodes.size, int), place)[0]
    lengths = 0.5 * shape.lengths(cells) * (np.sqrt(np.sum(r1 * r1, axis=0)) @ weights)
    return np.concatenate([[0.0], np.cumsum(lengths)])


def _slowed(p: Posed, shape: Shape, cells: Cells, start: float, deceleration: float, limit: str) -> _Pieces | None:
    """Return the cubics of a motion with the squared speed `start` and a constant deceleration, on divided cells.

    A cubic has the values and slopes of u̇² at both ends of its cell. None means that the cells cannot be small enough.
    """
    row = listed(p.bounds, p.vehicle is not None).index(limit)
    for _ in range(HALVINGS):
        r = shape.derivatives(*cells.places(2))
        square, along = np.sum(r[0] ** 2, axis=0), np.sum(r[0] * r[1], axis=0)
        place = _distances(shape, cells)
        w = start - 2 * deceleration * np.stack([place[:-1], place[1:]], axis=1)
        a = w / square
        slope = (-2 * deceleration * np.sqrt(square) - 2 * a * along) / square
        powers = _cubics(a, slope * shape.lengths(cells)[:, None])
        usage = _usage(p, shape, cells, powers)
        over = ~(usage[row] <= 1 - RESERVE / 10)
        if not over.any():
            return _Pieces(cells, powers, usage, np.zeros((len(NAMES), len(powers)), np.int32))
        cells = cells.halved(over)
    return None


def _cubics(a: Float[np.ndarray, "cells 2"], slope: Float[np.ndarray, "cells 2"]) -> Float[np.ndarray, "cells 4"]:
    """Return the coefficients of the cubics with these values and slopes at the ends of [0, 1]."""
    rise = a[:, 1] - a[:, 0]
    third = slope[:, 0] + slope[:, 1] - 2 * rise
    return np.stack([a[:, 0], slope[:, 0], rise - slope[:, 0] - third, third], axis=1)


def _usage(p: Posed, shape: Shape, cells: Cells, powers: Any) -> Float[np.ndarray, "limits cells"]:
    """Return the largest ratio of each quantity to its limit in each cell, at samples."""
    z, length = np.linspace(0.0, 1.0, CHECKED), shape.lengths(cells)[:, None]
    r = shape.derivatives(*cells.places(CHECKED))
    c = powers.T[..., None]
    a = c[0] + z * (c[1] + z * (c[2] + z * c[3]))
    v = np.stack([a, (c[1] + z * (2 * c[2] + 3 * z * c[3])) / length, (2 * c[2] + 6 * z * c[3]) / length**2])
    one: Any = np.ones(())
    k, place = np.repeat(np.arange(len(powers)), CHECKED), np.tile(z, len(powers))
    bounds = at_places(in_cells(p.bounds, *shape.parameters(cells, 2).T), k, place)
    with np.errstate(all="ignore"):
        vehicle = at_parameters(p.vehicle, shape.parameters(cells, CHECKED).ravel())
        found = used(parts(r.reshape(3, 3, -1), one, bounds, vehicle), v.reshape(3, -1))
    rows = ratios(found, listed(p.bounds, p.vehicle is not None))
    return np.max(rows.reshape(len(rows), *a.shape), axis=2)


def _joined(p: Posed, part: Part, timed: TimedPart, at: tuple[_Pieces, _Pieces, int], shape: Shape) -> Braked:
    """Return the timing of the braking, followed by the cells of the fastest timing from cell k on."""
    head, rest, k = at
    grid = head.cells.grid(shape.spans, part.first)
    codes = codes_of(p, grid, head.powers, (False, False))
    tail = _chosen(rest.cells, slice(k, None))
    cells = Cells(*(np.concatenate(x) for x in zip(head.cells, tail, strict=True)))
    powers = np.concatenate([head.powers, rest.powers[k:]])
    # The usage of a search refers to limits that are reduced by the margin.
    usage = np.concatenate([head.usage / (1 - MARGIN), rest.usage[:, k:]], axis=1)
    grid = cells.grid(shape.spans, part.first)
    start, end = np.asarray(part.start), np.asarray(part.end)
    knots = start + grid.knots * ((end - start) / grid.knots[-1])
    time = Timing(head.powers, knots[: len(head.powers) + 1], (False, False)).duration
    good = np.isin(rest.codes[[NAMES.index(name) for name in p.names]][:, k:], (PROVED, SAMPLED)).all()
    own = timed._replace(
        powers=powers, usage=usage, codes=np.concatenate([codes, rest.codes[:, k:]], axis=1), knots=knots
    )
    return Braked(own, grid, float(time), float(_distances(shape, head.cells)[-1]), bool(good))
