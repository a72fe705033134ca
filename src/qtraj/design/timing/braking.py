"""Start a timing above its limits: brake as strongly as the longitudinal acceleration may, to the fastest timing.

Let w be the squared speed, s the distance along the path, and A the limit. From the speed v the vehicle reaches at
least w = v² − 2As. The fastest timing for a free start loses at most as much, so both curves meet once. From there on,
the fastest timing satisfies every limit. With a limit on the jerk, both also have the same acceleration where they
meet: the vehicle brakes less and less before. Its first acceleration is free.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.proof.certificate import PROVED, SAMPLED
from qtraj.design.timing.cells import Cells, Shape
from qtraj.design.timing.constraint_values import ratios, used
from qtraj.design.timing.constraints import all_names, listed, parts
from qtraj.design.timing.deceleration import Deceleration, Met, constant, from_place, gradual
from qtraj.design.timing.end_advice import BRAKING
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

RESERVE = 1e-3
"""Fraction by which the deceleration stays below its limit, for the error of the cubics."""

MEETING, HALVINGS = 10, 12
"""How often the cell in which both curves meet is halved, and the largest number of halvings for the cubics."""

JOINT = 10
"""How often the cell in which the deceleration begins to decrease is halved; then this happens at one of its ends."""

EASIER, TRIES = 0.6, 6
"""Factor on the rate at which the deceleration decreases, and number of rates: in a bend, the jerk has other parts."""

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
    longitudinal acceleration, braking is unbounded. The result is also None if the vehicle is still too fast at the end
    of the part, or if an argument is traced.
    """
    timed, grid = found
    limit = next((name for name in BRAKING if name in p.bounds), None)
    if grid is None or is_traced(p.path, p.bounds, p.vehicle, speed) or limit is None:
        return None
    shape = shape_of(p.path, part)
    cells = Cells(grid.segment - part.first, grid.middle, grid.half)
    pieces = _Pieces(cells, *(np.asarray(x) for x in (timed.powers, timed.usage, timed.codes)))
    bounds = strictest(p.bounds)
    start, strongest = float(speed) ** 2, (1 - RESERVE) * -_lowest(limit, bounds)
    if not strongest > 0:
        return None
    heads = _heads(p, shape, pieces, (start, strongest, limit), (1 - RESERVE) * float(bounds.get("jerk", np.inf)))
    return _joined(p, part, timed, heads[0], shape) if heads else None


def _heads(
    p: Posed, shape: Shape, pieces: _Pieces, braking: tuple[float, float, str], jerk: float
) -> list[tuple[_Pieces, _Pieces, int]]:
    """Return the timing of the braking, the cells of the fastest timing, and the first one of these after braking.

    The list is empty if the vehicle cannot brake in time. With a limit on the jerk, the first item satisfies this limit
    while the deceleration decreases, if that is possible.
    """
    found = []
    for rate in jerk * EASIER ** np.arange(TRIES if np.isfinite(jerk) else 1):
        if (own := _head(p, shape, pieces, braking, rate)) is None:
            continue
        head, ends_gradually = own[0], own[3]
        if not np.isfinite(jerk):
            return [own[:3]]
        row = listed(p.bounds, p.vehicle is not None).index("jerk")
        found.append(own[:3])
        if (head.usage[row][ends_gradually:] <= 1).all():
            return found[-1:]
    return found


def _head(
    p: Posed, shape: Shape, pieces: _Pieces, braking: tuple[float, float, str], jerk: float
) -> tuple[_Pieces, _Pieces, int, int] | None:
    """Return the same for one rate `jerk`, and the first cell in which the deceleration decreases, or None."""
    start, strongest, limit = braking

    def meeting(x: _Pieces) -> tuple[int, Deceleration] | None:
        met = _met(shape, x)
        return gradual(start, strongest, jerk, met) if np.isfinite(jerk) else constant(start, strongest, met)

    met = meeting(pieces)
    for _ in range(MEETING):
        if met is None:
            return None
        pieces = pieces.halved(met[0] - 1)
        met = meeting(pieces)
    if met is None:
        return None
    k, found = met
    cells = _chosen(pieces.cells, slice(k))
    if np.isfinite(jerk):
        joint = _with_joint(shape, cells, found, _met(shape, pieces).at(k))
        if joint is None:
            return None
        cells, found = joint
    head = _slowed(p, shape, cells, found, limit)
    return None if head is None else (head, pieces, k, int(np.sum(_distances(shape, head.cells)[1:] <= found.place)))


def _with_joint(shape: Shape, cells: Cells, d: Deceleration, met: Met) -> tuple[Cells, Deceleration] | None:
    """Return cells with a knot at which the deceleration begins to decrease, and the deceleration for this knot."""
    for _ in range(JOINT):
        at = _distances(shape, cells)
        cells = cells.halved(np.arange(at.size - 1) == np.clip(np.searchsorted(at, d.place) - 1, 0, at.size - 2))
    at = _distances(shape, cells)[:-1]
    found = from_place(d, float(at[np.argmin(np.abs(at - d.place))]), met)
    return None if found is None else (cells, found)


def _met(shape: Shape, x: _Pieces) -> Met:
    """Return the squared speeds, the accelerations along the path and the distances at the knots of a timing."""
    r = shape.derivatives(*x.cells.places(2))
    square, along = np.sum(r[0] ** 2, axis=0), np.sum(r[0] * r[1], axis=0)
    c, last = x.powers, np.sum(x.powers * np.arange(4), axis=1)
    a, slope = np.stack([c[:, 0], c.sum(axis=1)], axis=1), np.stack([c[:, 1], last], axis=1)
    slope = slope / shape.lengths(x.cells)[:, None]
    with np.errstate(all="ignore"):  # at rest
        along = (0.5 * slope * square + a * along) / np.sqrt(square)
    squares, accelerations = (np.append(y[:, 0], y[-1, 1]) for y in (a * square, np.nan_to_num(along)))
    return Met(squares, accelerations, _distances(shape, x.cells))


def _lowest(limit: str, bounds: Any) -> float:
    """Return the lower bound on the acceleration along the path."""
    return quantity(limit).side * -float(bounds[limit])


def _chosen(cells: Cells, which: slice) -> Cells:
    return Cells(*(x[which] for x in cells))


def _distances(shape: Shape, cells: Cells) -> Float[np.ndarray, " cells+1"]:
    """Return the distances of the knots from the start [m]."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    place = cells.middle[:, None] + cells.half[:, None] * nodes
    r1 = shape.derivatives(cells.segment[:, None] + np.zeros(nodes.size, int), place)[0]
    lengths = 0.5 * shape.lengths(cells) * (np.sqrt(np.sum(r1 * r1, axis=0)) @ weights)
    return np.concatenate([[0.0], np.cumsum(lengths)])


def _slowed(p: Posed, shape: Shape, cells: Cells, braking: Deceleration, limit: str) -> _Pieces | None:
    """Return the cubics of a motion that brakes, on divided cells.

    A cubic has the values and slopes of u̇² at both ends of its cell. None means that the cells cannot be small enough.
    """
    rows = listed(p.bounds, p.vehicle is not None)
    for _ in range(HALVINGS):
        at_ends = _exact(shape, cells, braking, 2)
        powers = _cubics(at_ends[0], at_ends[1] * shape.lengths(cells)[:, None])
        usage = _usage(p, shape, cells, _of_cubics(powers, shape.lengths(cells)))
        over = ~(usage[rows.index(limit)] <= 1 - RESERVE / 10)
        if "jerk" in rows:
            exact = _usage(p, shape, cells, _exact(shape, cells, braking, CHECKED))[rows.index("jerk")]
            over |= ~(usage[rows.index("jerk")] <= np.maximum(exact, 1 - RESERVE) * (1 + RESERVE / 10))
        if not over.any():
            return _Pieces(cells, powers, usage, np.zeros((len(all_names(p.names)), len(powers)), np.int32))
        cells = cells.halved(over)
    return None


def _exact(shape: Shape, cells: Cells, braking: Deceleration, count: int) -> Float[np.ndarray, "3 cells {count}"]:
    """Return u̇² and its derivatives with respect to u while the vehicle brakes, at points of the cells."""
    r = shape.derivatives(*cells.places(count))
    square, along = np.sum(r[0] ** 2, axis=0), np.sum(r[0] * r[1], axis=0)
    bend = np.sum(r[1] ** 2 + r[0] * r[2], axis=0)
    squares, accelerations, rates = braking.at(_places(shape, cells, count))
    root, a = np.sqrt(square), squares / square
    with np.errstate(all="ignore"):
        slope = 2 * (accelerations * root - a * along) / square
        second = 2 * (rates * square / np.sqrt(squares) + accelerations * along / root)
        return np.stack([a, slope, (second - 4 * slope * along - 2 * a * bend) / square])


def _places(shape: Shape, cells: Cells, count: int) -> Float[np.ndarray, "cells {count}"]:
    """Return the distances of points of the cells from the start [m]."""
    ends = _distances(shape, cells)
    if count == 2:
        return np.stack([ends[:-1], ends[1:]], axis=1)
    place = cells.middle[:, None] + cells.half[:, None] * np.linspace(-1.0, 1.0, count)
    half = np.repeat(cells.half / (count - 1), count - 1)
    parts = Cells(np.repeat(cells.segment, count - 1), (0.5 * (place[:, 1:] + place[:, :-1])).ravel(), half)
    found = _distances(shape, parts)
    return np.concatenate([found[:-1].reshape(-1, count - 1), found[count - 1 :: count - 1, None]], axis=1)


def _of_cubics(powers: Float[np.ndarray, "cells 4"], lengths: Any) -> Float[np.ndarray, "3 cells {CHECKED}"]:
    """Return cubics and their derivatives with respect to u at points of the cells."""
    z, length, c = np.linspace(0.0, 1.0, CHECKED), lengths[:, None], powers.T[..., None]
    a = c[0] + z * (c[1] + z * (c[2] + z * c[3]))
    return np.stack([a, (c[1] + z * (2 * c[2] + 3 * z * c[3])) / length, (2 * c[2] + 6 * z * c[3]) / length**2])


def _cubics(a: Float[np.ndarray, "cells 2"], slope: Float[np.ndarray, "cells 2"]) -> Float[np.ndarray, "cells 4"]:
    """Return the coefficients of the cubics with these values and slopes at the ends of [0, 1]."""
    rise = a[:, 1] - a[:, 0]
    third = slope[:, 0] + slope[:, 1] - 2 * rise
    return np.stack([a[:, 0], slope[:, 0], rise - slope[:, 0] - third, third], axis=1)


def _usage(p: Posed, shape: Shape, cells: Cells, v: Any) -> Float[np.ndarray, "limits cells"]:
    """Return the largest ratio of each quantity to its limit in each cell, for `v` = (a, a', a'') at its points."""
    count = v.shape[1]
    r = shape.derivatives(*cells.places(CHECKED))
    one: Any = np.ones(())
    k, place = np.repeat(np.arange(count), CHECKED), np.tile(np.linspace(0.0, 1.0, CHECKED), count)
    bounds = at_places(in_cells(p.bounds, *shape.parameters(cells, 2).T), k, place)
    with np.errstate(all="ignore"):
        vehicle = at_parameters(p.vehicle, shape.parameters(cells, CHECKED).ravel())
        found = used(parts(r.reshape(3, 3, -1), one, bounds, vehicle), v.reshape(3, -1))
    rows = ratios(found, listed(p.bounds, p.vehicle is not None))
    return np.max(rows.reshape(len(rows), count, CHECKED), axis=2)


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
    good = np.isin(rest.codes[[all_names(p.names).index(name) for name in p.names]][:, k:], (PROVED, SAMPLED)).all()
    own = timed._replace(
        powers=powers, usage=usage, codes=np.concatenate([codes, rest.codes[:, k:]], axis=1), knots=knots
    )
    return Braked(own, grid, float(time), float(_distances(shape, head.cells)[-1]), bool(good))
