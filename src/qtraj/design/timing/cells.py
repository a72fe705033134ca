"""Choose the cells of a timing: small where the path bends, where its parameter slows, and where limits take turns.

The first cells are the segments of the path. A cell is halved while the path turns by more than `TURN` in it, or |r'|
varies by more than the factor `UNEVEN`. Then cells are halved where a cubic does not approximate the relaxed timing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.timing.grid import Grid
from qtraj.design.timing.relaxed import PLACES, Samples, Task, relaxed, squared_norm
from qtraj.design.varying import Varying, at_places, in_cells, varies
from qtraj.path.road_on_path import RoadOnPath

TURN, UNEVEN = 0.3, 2.0
"""Largest angle [rad] by which the path turns in a cell, and largest ratio of two values of |r'| in a cell."""

ALMOST_AT_REST = 1e-4
"""Ratio of |r'| of one of several bodies to its largest value, below which its direction does not count."""

SMALLEST = 1e-12
"""Fraction of the length of the path below which a cell is not halved because of the shape of the path."""

LONGER = 3.0
"""Largest ratio of the lengths of two neighbours: a smooth spline changes its slope only within several cells."""

FEWEST, MOST, MOST_EACH = 8, 2**14, 128
"""Smallest number of cells, and the number above which no cells are halved: the larger one of `MOST` and of `MOST_EACH`
for each segment."""

HALVINGS, PASSES = 48, 24
"""Largest numbers of halvings of a segment, and of passes over all cells."""

BEND = 0.1
"""Weight of the error of the jerk in the estimates of errors."""

NARROW = 0.25
"""Longest cell in which a limit changes, relative to the length of the path times the accuracy, for one change."""

GAINED = 8.0
"""Factor by which the error of half a cell is smaller than that of a cell, where the timing is smooth."""

FINE = 2 * PLACES - 1
"""Number of points in a cell at which |r'| is evaluated for its length."""

Derivatives = Callable[[Int[np.ndarray, "*n"], Float[np.ndarray, "*n"]], Float[np.ndarray, "3 components *n"]]
"""Function that returns the first three derivatives of the path at places −1 ≤ s ≤ 1 in segments.

The components are those of all bodies."""


class Cells(NamedTuple):
    """Cells in order; each is the part `middle` ± `half` of a segment, in which −1 ≤ s ≤ 1."""

    segment: Int[np.ndarray, " cells"]
    middle: Float[np.ndarray, " cells"]
    half: Float[np.ndarray, " cells"]

    def halved(self, which: Bool[np.ndarray, " cells"]) -> Cells:
        """Return the cells with some of them divided into two."""
        count = 1 + which
        segment, middle, half = (np.repeat(x, count) for x in self)
        first = (np.cumsum(count) - count)[which]
        for side, sign in ((first, -1.0), (first + 1, 1.0)):
            half[side] /= 2
            middle[side] += sign * half[side]
        return Cells(segment, middle, half)

    def places(self, count: int) -> tuple[Int[np.ndarray, "cells count"], Float[np.ndarray, "cells count"]]:
        """Return the segments and places of `count` equidistant points in each cell."""
        place = self.middle[:, None] + self.half[:, None] * np.linspace(-1.0, 1.0, count)
        return self.segment[:, None] + np.zeros(count, int), place

    def grid(self, spans: Float[np.ndarray, " segments"], first: int) -> Grid:
        """Return the grid of the cells; `spans` are the durations of the segments, whose indices start at `first`."""
        starts = np.concatenate([[0.0], np.cumsum(spans)])
        at = starts[self.segment] + 0.5 * (self.middle - self.half + 1) * spans[self.segment]
        return Grid(np.append(at, starts[-1]) * (at.size / starts[-1]), self.segment + first, self.middle, self.half)


class Shape(NamedTuple):
    """The derivatives of a path in its segments, and the durations and the starts of the segments."""

    derivatives: Derivatives
    spans: Float[np.ndarray, " segments"]
    starts: Float[np.ndarray, " segments"]

    @property
    def most(self) -> int:
        """The number of cells above which no cells are halved."""
        return max(MOST, MOST_EACH * self.spans.size)

    def lengths(self, cells: Cells) -> Float[np.ndarray, " cells"]:
        """Return the lengths of cells in the parameter of the path."""
        return cells.half * self.spans[cells.segment]

    def parameters(self, cells: Cells, count: int) -> Float[np.ndarray, "cells count"]:
        """Return the parameters of the path at `count` equidistant points in each cell."""
        segment, place = cells.places(count)
        return self.starts[segment] + 0.5 * self.spans[segment] * (1 + place)


def resolved(shape: Shape) -> Cells:
    """Return cells in which the path turns little, and in which |r'| varies little."""
    count = shape.spans.size
    cells, total = Cells(np.arange(count), np.zeros(count), np.ones(count)), 0.0
    fastest = None
    while cells.half.size < FEWEST:
        cells = cells.halved(np.ones(cells.half.size, bool))
    candidates = np.ones(cells.half.size, bool)
    for _ in range(HALVINGS):
        own = Cells(*(x[candidates] for x in cells))
        r1 = shape.derivatives(*own.places(FINE))[0]
        speed = np.sqrt(squared_norm(r1))
        length = speed.mean(axis=1) * shape.lengths(own)
        total = total or length.sum()
        bodies = r1.reshape(-1, 3, *r1.shape[1:])
        fastest = np.linalg.norm(bodies, axis=1).max(axis=(1, 2)) if fastest is None else fastest
        turn = _turns(bodies, fastest).max(axis=0)
        uneven = speed.max(axis=1) > UNEVEN * speed.min(axis=1)
        halved = np.zeros(candidates.size, bool)
        halved[candidates] = ((turn > TURN) | uneven) & (length > SMALLEST * total)
        if not halved.any():
            break
        cells, candidates = cells.halved(halved), np.repeat(halved, 1 + halved)
    return cells


def _turns(
    r1: Float[np.ndarray, "bodies 3 cells {FINE}"], fastest: Float[np.ndarray, " bodies"]
) -> Float[np.ndarray, "bodies cells"]:
    """Return the angles by which bodies turn in the cells [rad]; one of several bodies may be at rest.

    `fastest` are the largest |r'| of the bodies on the whole path.
    """
    after, before = r1[..., 1:], r1[..., :-1]
    across = np.linalg.norm(np.cross(after, before, axis=1), axis=1)
    turns = np.arctan2(across, np.sum(after * before, axis=1))
    if len(r1) > 1:  # the direction of a body that is almost at rest consists of rounding errors
        turns = np.where(np.linalg.norm(before, axis=1) > ALMOST_AT_REST * fastest[:, None, None], turns, 0.0)
    return turns.sum(axis=-1)


class Profile(NamedTuple):
    """A timing at the samples of cells: a = u̇², |r'|, and bounds on the acceleration [m/s²]; and in each cell.

    `fourth` are the absolute fourth differences of a in a cell, and `times` [s] the times in the cells. `bounds` is
    whether no timing within the limits is faster.
    """

    a: Samples
    pace: Samples
    accelerations: Samples
    fourth: Float[np.ndarray, " cells"]
    times: Float[np.ndarray, " cells"]
    bounds: bool

    @property
    def least(self) -> float:
        """A lower bound on the duration [s], or −inf if none is known."""
        return float(self.times.sum()) if self.bounds else -np.inf


def relaxed_profile(shape: Shape, task: Task, cells: Cells) -> Profile:
    """Return the profile of the relaxed timing."""
    r = shape.derivatives(*cells.places(FINE))
    speed = np.sqrt(squared_norm(r[0]))
    simpson = (speed[:, :-2:2] + 4 * speed[:, 1::2] + speed[:, 2::2]) / 6
    distances = simpson * (shape.lengths(cells) / (PLACES - 1))[:, None]
    if varies(task.bounds):
        low, high = shape.parameters(cells, 2).T
        cell, place = np.repeat(np.arange(low.size), PLACES), np.tile(np.linspace(0.0, 1.0, PLACES), low.size)
        task = task._replace(bounds=at_places(in_cells(task.bounds, low, high), cell, place))
    if isinstance(task.vehicle, RoadOnPath):
        task = task._replace(vehicle=task.vehicle.at(shape.parameters(cells, PLACES).ravel()))
    found, pace = relaxed(r[..., ::2], distances, task), speed[:, ::2]
    a = np.divide(found.squares, pace**2, out=np.zeros_like(pace), where=pace > 0)
    fourth = np.abs(a @ np.array([1.0, -4.0, 6.0, -4.0, 1.0]))
    return Profile(a, pace, found.accelerations, fourth, found.times, found.bounds)


def chosen(shape: Shape, task: Task, accuracy: float) -> tuple[Cells, bool]:
    """Return cells that approximate the relaxed timing, and whether no timing within the limits is faster.

    `accuracy` is the largest relative error of the duration.
    """
    cells, bounds = _with_changes(shape, task, resolved(shape), accuracy), False
    for _ in range(PASSES):
        profile = relaxed_profile(shape, task, cells)
        bounds = profile.bounds
        time, error = float(profile.times.sum()), _errors(shape, task, cells, profile)
        if not error.sum() > accuracy * time or error.size > shape.most // 2:
            break
        cells = cells.halved(error > accuracy * time / error.size)
    return _graded(shape, cells), bounds


def _with_changes(shape: Shape, task: Task, cells: Cells, accuracy: float) -> Cells:
    """Halve cells in which a limit changes, because the stricter value holds in the whole cell."""
    changing: list[Any] = [x for x in (*task.bounds.values(), task.vehicle) if isinstance(x, Varying | RoadOnPath)]
    places = np.unique(np.concatenate([np.zeros(0), *(x.changes() for x in changing)]))
    if not places.size:
        return cells
    on = changing[0].on
    longest = accuracy * on.length * NARROW / places.size
    for _ in range(HALVINGS):
        ends = on.at(shape.parameters(cells, 2).ravel()).reshape(-1, 2)
        inside = np.searchsorted(places, ends[:, 1], side="right") > np.searchsorted(places, ends[:, 0])
        halved = inside & (np.diff(ends, axis=1)[:, 0] > longest)
        if not halved.any() or cells.half.size + halved.sum() > shape.most // 4:
            break
        cells = cells.halved(halved)
    return cells


def finest(shape: Shape, task: Task, cells: Cells) -> float:
    """Return the lower bound on the duration that the halves of the cells imply."""
    return relaxed_profile(shape, task, cells.halved(np.ones(cells.half.size, bool))).least


def refined(
    shape: Shape,
    task: Task,
    accuracy: float,
    cells: Cells,
    timing: tuple[Float[np.ndarray, "cells 4"], Float[np.ndarray, " cells"], Float[np.ndarray, " cells"], Profile],
) -> Cells:
    """Halve cells where a timing is not smooth, or where limits are much tighter between the nodes than at the nodes.

    `timing` contains the coefficients of a = u̇² in the cells, the times in the cells and those that are lost there by
    tighter limits [s], and the relaxed timing. The third derivative of a smooth function hardly jumps.
    """
    powers, times, lost, least = timing
    length = shape.lengths(cells)
    jump = np.pad(np.abs(np.diff(6 * powers[:, 3] / length**3)), 1)
    jump[1:-1][np.diff(cells.segment) > 0] = 0.0
    fourth = np.maximum(jump[1:], jump[:-1]) * length**3 / (PLACES - 1) ** 4
    a = powers @ np.linspace(0.0, 1.0, PLACES) ** np.arange(4)[:, None]
    error = lost + _errors(shape, task, cells, least._replace(a=a, fourth=fourth, times=times))
    allowed = accuracy * times.sum() / error.size
    for _ in range(2):
        halved = error > allowed
        if cells.half.size + halved.sum() > shape.most:
            break
        cells, error = cells.halved(halved), np.repeat(np.where(halved, error / GAINED, error), 1 + halved)
    return _graded(shape, cells)


def divided(shape: Shape, cells: Cells, which: Bool[np.ndarray, " cells"]) -> Cells:
    """Halve some cells, and neighbours that are then much longer."""
    return _graded(shape, cells.halved(which))


def with_positive(
    shape: Shape, cells: Cells, powers: Float[np.ndarray, "cells 4"], times: Float[np.ndarray, " cells"]
) -> Cells:
    """Halve cells in which a = u̇² with the coefficients `powers` is not positive everywhere, and their neighbours.

    Samples may miss a short range of negative values. It makes the `times` from this cell onwards NaN.
    """
    a = powers @ np.linspace(0.0, 1.0, FINE) ** np.arange(4)[:, None]
    bad, undefined = ~(a[:, 1:-1] > 0).all(axis=1), ~np.isfinite(times)
    bad = np.pad(bad | (undefined & (np.cumsum(undefined) == 1)), 1)
    return _graded(shape, cells.halved(bad[1:-1] | bad[2:] | bad[:-2]))


def _errors(shape: Shape, task: Task, cells: Cells, p: Profile) -> Float[np.ndarray, " cells"]:
    """Return estimates of the errors of the times in cells, if a is approximated by a cubic in each cell.

    An estimate is the sum of the errors of a, of its slope and of its second derivative, relative to a, and to what
    the limits on acceleration and jerk allow: a timing accelerates less than it may where its slope oscillates.
    """
    length = shape.lengths(cells)
    with np.errstate(all="ignore"):  # without motion, the estimates are zero
        a, pace, accelerations = (x[:, 1:-1].mean(axis=1) for x in p[:3])
        value = p.fourth / (32 * a)
        slope = p.fourth * pace / (4 * length * accelerations)
        bend = BEND * p.fourth * pace * np.sqrt(a) / (length**2 * task.jerk)
        return p.times * (np.nan_to_num(value) + sum(np.minimum(np.nan_to_num(x), 1.0) for x in (slope, bend)))


def _graded(shape: Shape, cells: Cells) -> Cells:
    """Halve cells that are much longer than a neighbour."""
    while True:
        length = np.pad(shape.lengths(cells), 1, constant_values=np.inf)
        long = length[1:-1] > LONGER * np.minimum(length[2:], length[:-2])
        if not long.any():
            return cells
        cells = cells.halved(long)
