"""Compute the fastest timing of one part of a path, prove its limits, and choose its cells.

The cells are chosen for an accuracy of the relaxed timing. If the timing is slower than the relaxed one by more than
the tolerance, it is computed again on smaller cells, until it is fast enough or hardly becomes faster.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.proof.certificate import PROVED, SAMPLED
from qtraj.design.timing.cells import Shape, chosen, refined
from qtraj.design.timing.constraints import NAMES, POWERS, listed
from qtraj.design.timing.grid import Grid, of_segments, path_derivatives, uniform
from qtraj.design.timing.parts import Part, known_segments
from qtraj.design.timing.proof import prove
from qtraj.design.timing.relaxed import Task
from qtraj.design.timing.search import Found, Problem, fastest
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

ACCURACY, CHANGE, ATTEMPTS = 0.1, 0.3, 4
"""The accuracy of the cells and the change of the duration that ends the attempts, as fractions of the tolerance."""

COARSE = 0.03
"""Accuracy of the first cells with a limit on the jerk, because the relaxed timing ignores it."""

SLOWER = (3e-5, 3e-4, 3e-3)
"""Fractions by which u̇² is reduced until all limits are proved: in sharp bends, rounding errors exceed the margin."""


KNOTS = 512
"""Number of cells of a part if they cannot be chosen, because the path or a limit is traced."""


class Posed(NamedTuple):
    """A path, its polynomials or None, its limits with their names, and the arguments of `retime` for its cells.

    `knots` is None if the cells are chosen for the `tolerance`.
    """

    path: AbstractHodograph
    polynomials: Source | None
    bounds: dict[str, Scalar]
    vehicle: RoadParameters | None
    names: tuple[str, ...]
    lap: bool
    knots: int | None
    tolerance: float


class TimedPart(NamedTuple):
    """The timing of a part: coefficients of u̇², usage and status of limits in each cell, knots, and search result.

    The usage of a limit is the ratio of the quantity to the limit. The search result and the grid are None for a stop.
    `excess` is the estimated difference to the smallest duration with more cells [s], or NaN.
    """

    powers: Float[Any, "cells 4"]
    usage: Float[Any, "limits cells"]
    codes: Int[Any, "limits cells"]
    knots: Float[Any, " cells+1"]
    found: Found | None = None
    grid: Grid | None = None
    excess: Any = np.zeros(())


def timed(p: Posed, part: Part, ends: Any, rest: tuple[bool, bool]) -> TimedPart:
    """Return the fastest timing of a part of the path, with a proof of its limits.

    `ends` are the bounds on u̇² at both ends, and `rest` indicates where u̇² is zero.
    """
    if not part.moves:
        rows = len(listed(p.names, p.vehicle is not None))
        knots = np.stack([np.asarray(part.start), np.asarray(part.end)])
        stands = np.full((len(NAMES), 1), PROVED, np.int32)
        return TimedPart(np.array([[1.0, 0, 0, 0]]), np.zeros((rows, 1)), stands, knots)
    known = constants((p.path, p.bounds, p.vehicle, ends))
    if p.knots is not None or is_traced(known):
        return _proved(p, rest, _searched(p, part, _fixed(p, part), ends, rest)[0])
    shape = _shape(known[0], part)
    task = _task(known, p.lap, part, rest, shape)
    accuracy = ACCURACY * p.tolerance
    cells, least = chosen(shape, task, accuracy)
    if "jerk" in p.bounds:
        cells, _ = chosen(shape, task, COARSE)
    found, times = _searched(p, part, cells.grid(shape.spans, part.first), ends, rest)
    excess = times.sum() - least
    for _ in range(ATTEMPTS):
        before = times.sum()
        if not excess > p.tolerance * before:
            break
        count, cells = len(times), refined(shape, task, accuracy, cells, np.asarray(constants(found.powers)), times)
        if cells.half.size == count:
            break
        finer, times = _searched(p, part, cells.grid(shape.spans, part.first), ends, rest, found)
        if not times.sum() < before:  # the search failed, or the duration is the smallest to within its tolerance
            break
        found, excess = finer, min(times.sum() - least, before - times.sum())
        if excess < CHANGE * p.tolerance * before:
            break
    return _proved(p, rest, found._replace(excess=np.asarray(max(excess, 0.0))))


def _fixed(p: Posed, part: Part) -> Grid:
    """Return cells of almost equal length."""
    if not isinstance(p.path, Route):
        return uniform(p.knots or KNOTS)
    cells = max(p.knots or KNOTS, 1 << (2 * (part.last - part.first) - 1).bit_length())
    starts = known_segments(p.path).starts[part.first : part.last]
    return of_segments(np.append(starts, part.end), part.first, cells, part.stops)


def _shape(path: AbstractHodograph, part: Part) -> Shape:
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


def _task(known: Any, lap: bool, part: Part, rest: tuple[bool, bool], shape: Shape) -> Task:
    """Return the limits with concrete values, and the largest squared speeds at both ends."""
    _, bounds, vehicle, ends = known
    r1 = shape.derivatives(np.array([0, shape.spans.size - 1]), np.array([-1.0, 1.0]))[0]
    at_rest = np.array(rest) | np.array(part.stops)
    squares = np.where(at_rest, 0.0, np.asarray(ends) * np.sum(r1 * r1, axis=0))
    most = float(squares[0]), float(squares[1])
    return Task({name: np.asarray(x) for name, x in bounds.items()}, vehicle, most, lap)


def _searched(
    p: Posed, part: Part, grid: Grid, ends: Any, rest: tuple[bool, bool], before: TimedPart | None = None
) -> tuple[TimedPart, Any]:
    """Return the timing, and the times in its cells [s] as known numbers, if they can be known.

    The search starts from the timing `before`, if it is given, whose cells are divided by those of the grid.
    """
    start, end = (x if is_traced(x) else np.asarray(x) for x in part[:2])
    joint = np.diff(grid.segment) > 0
    smooth = np.full(grid.cells - 1, 2)
    smooth[joint] = part.smooth[grid.segment[:-1][joint] - part.first]
    problem = Problem(p.path, start, end, p.bounds, ends, p.vehicle, np.array(part.stops))
    t, first = tables(grid, rest, p.lap, smooth), None
    if before is not None and before.grid is not None:
        scale = grid.knots[-1] / before.grid.knots[-1]
        first = inserted(t.grid.knots, np.asarray(constants(before.powers)), before.grid.knots * scale)
    found = fastest(problem, t, first)
    codes = np.full((len(NAMES), grid.cells), SAMPLED, np.int32)
    knots = start + grid.knots * ((end - start) / grid.knots[-1])
    timing = Timing(*constants((found.powers, knots)), rest)
    times = None if is_traced(timing) else np.diff(np.asarray(timing.times))
    return TimedPart(found.powers, found.usage, codes, knots, found, grid, np.asarray(np.nan)), times


def _proved(p: Posed, rest: tuple[bool, bool], x: TimedPart) -> TimedPart:
    """Return the timing with the status of all limits; slow it down if a limit is not proved."""
    if p.polynomials is None:
        return x
    codes = _codes(p, rest, x)
    rows = [NAMES.index(name) for name in p.names]
    for fraction in () if is_traced(constants(x.powers)) else SLOWER:
        if (codes[rows] == PROVED).all():
            break
        slower = _slower(p, x, fraction)
        found = _codes(p, rest, slower)
        if (found[rows] == PROVED).sum() > (codes[rows] == PROVED).sum():
            x, codes = slower, found
    return x._replace(codes=codes)


def _codes(p: Posed, rest: tuple[bool, bool], x: TimedPart) -> Any:
    assert x.found is not None
    assert x.grid is not None
    assert p.polynomials is not None
    # Nothing is proved about a timing that no limit bounds, because the proofs could take long.
    xp = namespace(x.found.unbounded, x.powers)
    given = {name: xp.where(x.found.unbounded, np.nan, p.bounds[name]) for name in p.names}
    powers, given, road = constants((x.powers, given, p.vehicle))
    return prove(p.polynomials, x.grid, (powers, np.array(rest)), given, road).codes


def _slower(p: Posed, x: TimedPart, fraction: float) -> TimedPart:
    """Return the timing with u̇² reduced by a fraction; only the usage of friction and power does not change."""
    factors = [(1 - fraction) ** POWERS.get(name, 0.0) for name in listed(p.names, p.vehicle is not None)]
    return x._replace(powers=x.powers * (1 - fraction), usage=x.usage * np.array(factors)[:, None])
