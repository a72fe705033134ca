"""Compute the fastest timing of one part of a path, choose its cells, and prove its limits.

The first cells approximate the relaxed timing. If the timing is slower than the relaxed one by more than the tolerance,
cells are halved where the timing is not smooth, and it is computed again, until it hardly becomes faster.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.proof.certificate import PROVED, SAMPLED
from qtraj.design.timing.cells import MOST, Shape, chosen, refined, with_positive
from qtraj.design.timing.constraints import NAMES, POWERS, listed
from qtraj.design.timing.grid import Grid, of_segments, path_derivatives, uniform
from qtraj.design.timing.parts import Part, known_segments
from qtraj.design.timing.proof import prove
from qtraj.design.timing.relaxed import Task
from qtraj.design.timing.search import Found, Problem, fastest, last_gap
from qtraj.design.timing.sources import Source
from qtraj.design.timing.spline import inserted
from qtraj.design.timing.tables import tables
from qtraj.design.timing.timing import Timing
from qtraj.foundation.arrays import constants, is_traced
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.vehicle import RoadParameters

KNOTS = 512
"""Number of cells of a part if they cannot be chosen, because the path or a limit is traced."""

ACCURACY, CHANGE, ATTEMPTS = 0.2, 0.3, 6
"""As fractions of the tolerance, the accuracy of the cells, and the change of the duration at which cells are no longer
halved; and how often they are halved."""

COUPLED, FINER = {"acceleration", "yaw_acceleration", "jerk", "friction", "power"}, 0.2
"""Limits with which the relaxed timing is faster than the fastest one, and without which the accuracy of the cells is
multiplied by `FINER` if the duration hardly changes."""

LEAST_ERROR = 0.1
"""With chosen cells, an optimality error of at most this fraction of the tolerance is small enough."""

COARSE = 0.03
"""Accuracy of the first cells with a limit on the jerk, because the relaxed timing ignores it."""

SLOWER = (3e-5, 3e-4, 3e-3)
"""Fractions by which u̇² is reduced until all limits are proved: in sharp bends, rounding errors exceed the margin."""


class Posed(NamedTuple):
    """A path, its polynomials or None, its limits with their names, and the arguments of `retime` for its cells.

    `knots` is None if the cells are chosen for the `tolerance`. The squared rate u̇² of the result is reduced by the
    fraction `slower`.
    """

    path: AbstractHodograph
    polynomials: Source | None
    bounds: dict[str, Scalar]
    vehicle: RoadParameters | None
    names: tuple[str, ...]
    lap: bool
    knots: int | None
    tolerance: float
    slower: float = 0.0


class TimedPart(NamedTuple):
    """The timing of a part: coefficients of u̇², usage and status of limits in each cell, and knots.

    The usage of a limit is the ratio of the quantity to the limit. `found` is the result of the search, and None for a
    stop. `enough` is the largest optimality error of a search that converged, and `excess` the estimated difference to
    the minimum duration over all timings [s], or NaN.
    """

    powers: Float[Any, "cells 4"]
    usage: Float[Any, "limits cells"]
    codes: Int[Any, "limits cells"]
    knots: Float[Any, " cells+1"]
    found: Found | None = None
    enough: Any = np.zeros(())
    excess: Any = np.zeros(())


class _Searched(NamedTuple):
    """The result of a search on a grid, the knots of the timing, and whether u̇² is zero at its ends."""

    grid: Grid
    found: Found
    knots: Float[Any, " cells+1"]
    enough: float
    rest: tuple[bool, bool]

    @property
    def powers(self) -> Float[np.ndarray, "cells 4"]:
        """The coefficients of u̇² as known numbers, even if they are differentiated."""
        return np.asarray(constants(self.found.powers))

    def times(self) -> Float[np.ndarray, " cells"]:
        """Return the times in the cells [s] as known numbers."""
        return np.diff(np.asarray(Timing(self.powers, constants(self.knots), self.rest).times))


def timed(p: Posed, part: Part, ends: Any, rest: tuple[bool, bool]) -> tuple[TimedPart, Grid | None]:
    """Return the fastest timing of a part of the path with a proof of its limits, and its cells, or None for a stop.

    `ends` are the bounds on u̇² at both ends, and `rest` indicates where u̇² is zero.
    """
    if not part.moves:
        rows = len(listed(p.names, p.vehicle is not None))
        knots = np.stack([np.asarray(part.start), np.asarray(part.end)])
        stands = np.full((len(NAMES), 1), PROVED, np.int32)
        return TimedPart(np.array([[1.0, 0, 0, 0]]), np.zeros((rows, 1)), stands, knots), None
    if p.knots is not None or is_traced(p.path, p.bounds, p.vehicle, ends):  # other cells would be compiled anew
        x, excess = _searched(p, part, _fixed(p, part), ends, rest), np.nan
    else:
        shape = shape_of(p.path, part)
        x, excess = _on_chosen_cells(p, part, ends, rest, shape, _task(p, ends, part, rest, shape))
    powers, usage, codes, slower = _proved(p, x)
    excess = excess + (1 - (1 - slower) ** 0.5) * x.times().sum() if slower else excess
    return TimedPart(powers, usage, codes, x.knots, x.found, np.asarray(x.enough), np.asarray(excess)), x.grid


def moving_time(parts: list[tuple[TimedPart, Grid | None]], rest: tuple[bool, bool]) -> float:
    """Return the total time on the parts that move [s]; `rest` indicates where u̇² is zero on the whole path."""
    total = 0.0
    for k, (part, grid) in enumerate(parts):
        own = rest[0] and k == 0, rest[1] and k == len(parts) - 1
        total += 0.0 if grid is None else float(Timing(part.powers, part.knots, own).duration)
    return total


def _fixed(p: Posed, part: Part) -> Grid:
    """Return cells of almost equal length."""
    if not isinstance(p.path, Route):
        return uniform(p.knots or KNOTS)
    cells = max(p.knots or KNOTS, 1 << (2 * (part.last - part.first) - 1).bit_length())
    starts = known_segments(p.path).starts[part.first : part.last]
    return of_segments(np.append(starts, part.end), part.first, cells, part.stops)


def _on_chosen_cells(
    p: Posed, part: Part, ends: Any, rest: tuple[bool, bool], shape: Shape, task: Task
) -> tuple[_Searched, float]:
    """Return the result of the last search, and the estimated difference to the minimum duration [s]."""
    accuracy = ACCURACY * p.tolerance
    cells, least = chosen(shape, task, accuracy)
    exact = np.isfinite(least) and not COUPLED & set(p.names)
    if "jerk" in p.bounds:
        cells, _ = chosen(shape, task, COARSE)
    found = _searched(p, part, cells.grid(shape.spans, part.first), ends, rest)
    for _ in range(ATTEMPTS):
        # Without finite coefficients, the limits contradict each other, and smaller cells do not help.
        if np.isfinite(found.times()).all() or not np.isfinite(found.powers).all() or cells.half.size > MOST // 2:
            break
        cells = with_positive(shape, cells, found.powers)
        found = _searched(p, part, cells.grid(shape.spans, part.first), ends, rest)
    times = found.times()
    excess = times.sum() - least
    for _ in range(ATTEMPTS):
        before = times.sum()
        if not excess > p.tolerance * before:
            break
        halved = refined(shape, task, accuracy, cells, found.powers, times)
        if halved.half.size == cells.half.size:
            if exact:
                accuracy *= FINER
                continue
            halved = cells.halved(np.ones(cells.half.size, bool))  # shows whether the duration still changes
        cells = halved
        grid = cells.grid(shape.spans, part.first)
        finer = _searched(p, part, grid, ends, rest, found)
        if not finer.found.error < finer.enough:
            finer = _searched(p, part, grid, ends, rest)
        times = finer.times()
        gained = before - times.sum()
        if gained > 0:
            found, excess = finer, times.sum() - least if exact else min(times.sum() - least, gained)
        if not gained > CHANGE * p.tolerance * before:
            if not exact or np.isnan(gained):
                break
            accuracy *= FINER
    enough = max(found.enough, LEAST_ERROR * p.tolerance)
    return found._replace(enough=enough), float(np.maximum(excess, 0.0)) if np.isfinite(excess) else np.nan


def shape_of(path: AbstractHodograph, part: Part) -> Shape:
    """Return the derivatives of a part of a path with concrete values."""
    if isinstance(path, Route):
        segments = known_segments(path).part(slice(part.first, part.last))

        def of_route(i: np.ndarray, place: np.ndarray) -> np.ndarray:
            rows = segments.values(i, 0.5 * segments.durations[i] * (1 + place), 3)[1:]
            return np.moveaxis(np.stack(rows), -1, 1)

        return Shape(of_route, segments.durations)
    duration = float(np.asarray(path.duration))

    def of_any(_: np.ndarray, place: np.ndarray) -> np.ndarray:
        found = np.asarray(path_derivatives(path, 0.5 * duration * (1 + place.ravel())))
        return found.reshape(3, 3, *place.shape)

    return Shape(of_any, np.array([duration]))


def _task(p: Posed, ends: Any, part: Part, rest: tuple[bool, bool], shape: Shape) -> Task:
    """Return the limits, and the largest squared speeds at both ends."""
    r1 = shape.derivatives(np.array([0, shape.spans.size - 1]), np.array([-1.0, 1.0]))[0]
    at_rest = np.array(rest) | np.array(part.stops)
    squares = np.where(at_rest, 0.0, np.asarray(ends)) * np.sum(r1 * r1, axis=0)
    most = float(squares[0]), float(squares[1])
    return Task({name: np.asarray(x) for name, x in p.bounds.items()}, p.vehicle, most, p.lap)


def _searched(
    p: Posed, part: Part, grid: Grid, ends: Any, rest: tuple[bool, bool], before: _Searched | None = None
) -> _Searched:
    """Search for the fastest timing, starting from the timing `before`, whose cells are divided by those of `grid`."""
    span: Any = [x if is_traced(x) else np.asarray(x) for x in part[:2]]
    start, end = span
    joint = np.diff(grid.segment) > 0
    smooth = np.full(grid.cells - 1, 2)
    smooth[joint] = part.smooth[grid.segment[:-1][joint] - part.first]
    t, first = tables(grid, rest, p.lap, smooth), None
    if before is not None:
        scale = grid.knots[-1] / before.grid.knots[-1]
        first = inserted(t.grid.knots, before.powers, before.grid.knots * scale, p.lap)
    problem = Problem(p.path, start, end, p.bounds, ends, p.vehicle, np.array(part.stops))
    knots = start + grid.knots * ((end - start) / grid.knots[-1])
    return _Searched(grid, fastest(problem, t, first), knots, last_gap(t.grid.cells, "jerk" in p.bounds), rest)


def _proved(p: Posed, x: _Searched) -> tuple[Any, Any, Any, float]:
    """Return the coefficients of u̇², the usage and the status of limits; slow down the timing if one is not proved.

    The last result is the fraction by which u̇² is reduced for the proofs.
    """
    exponents = np.array([POWERS.get(name, 0.0) for name in listed(p.names, p.vehicle is not None)])[:, None]
    powers, usage = x.found.powers, x.found.usage
    if p.slower:
        powers, usage = (1 - p.slower) * powers, usage * (1 - p.slower) ** exponents
    codes = codes_of(p, x.grid, powers, x.rest, x.found.unbounded)
    if p.polynomials is None or is_traced(constants(powers)):
        return powers, usage, codes, 0.0
    rows = [NAMES.index(name) for name in p.names]
    first, reduced = (powers, usage), 0.0
    for fraction in SLOWER:
        if (codes[rows] == PROVED).all():
            break
        slower = (1 - fraction) * first[0]
        found = codes_of(p, x.grid, slower, x.rest, x.found.unbounded)
        if (found[rows] == PROVED).sum() > (codes[rows] == PROVED).sum():
            powers, codes, usage, reduced = slower, found, first[1] * (1 - fraction) ** exponents, fraction
    return powers, usage, codes, reduced


def codes_of(p: Posed, grid: Grid, powers: Any, rest: tuple[bool, bool], unbounded: Any = False) -> Any:
    """Return the status of all limits in all cells; SAMPLED if the path is not polynomial."""
    if p.polynomials is None:
        return np.full((len(NAMES), grid.cells), SAMPLED, np.int32)
    # Nothing is proved about a timing that no limit bounds, because the proofs could take long.
    xp = namespace(unbounded, powers)
    given = {name: xp.where(unbounded, np.nan, p.bounds[name]) for name in p.names}
    own, given, road = constants((powers, given, p.vehicle))
    return prove(p.polynomials, grid, (own, np.array(rest)), given, road).codes
