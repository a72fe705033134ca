"""Search for the fastest timing of one part of a path on given cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.ellipse import OfSpeed
from qtraj.design.timing.bodies import rows_of
from qtraj.design.timing.cells import Shape
from qtraj.design.timing.formula_limits import of_third_order
from qtraj.design.timing.grid import Grid, path_derivatives
from qtraj.design.timing.parts import Part, known_segments
from qtraj.design.timing.relaxed import Task
from qtraj.design.timing.rounds import NOT_ROUGH, Rough, last_gap
from qtraj.design.timing.search import Draft, Found, Problem, completed, drafted, fastest
from qtraj.design.timing.sources import Source
from qtraj.design.timing.spline import inserted
from qtraj.design.timing.tables import Tables, tables
from qtraj.design.timing.timing import Timing
from qtraj.design.varying import Varying
from qtraj.foundation.arrays import constants, is_traced
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.route import Route

Held = tuple[float | None, float | None]
"""Prescribed values of u̇² at the start and at the end; None for an end at which it is only bounded."""


class Posed(NamedTuple):
    """A path, its polynomials or None, its limits with their names, and the arguments of `retime` for its cells.

    `knots` is None if the cells are chosen for the `tolerance`. The squared rate u̇² of the result is reduced by the
    fraction `slower`. `others` are the paths and the limits of further bodies with the same timing. `held` are the
    prescribed values of u̇² at the ends.
    """

    path: AbstractHodograph
    polynomials: Source | None
    bounds: dict[str, Any]
    vehicle: RoadParameters | RoadOnPath | None
    names: tuple[str, ...]
    lap: bool
    knots: int | None
    tolerance: float
    slower: float = 0.0
    others: tuple[tuple[AbstractHodograph, dict[str, Any]], ...] = ()
    held: Held = (None, None)

    @property
    def all_bounds(self) -> tuple[dict[str, Any], ...]:
        """The limits of all bodies."""
        return (self.bounds, *(bounds for _, bounds in self.others))

    @property
    def rows(self) -> tuple[str, ...]:
        """The names of the limits in the order of the rows of arrays."""
        return rows_of(self.all_bounds, self.vehicle is not None)

    @property
    def limits_jerk(self) -> bool:
        """Whether a limit contains the jerk of a body."""
        return any(of_third_order(bounds) for bounds in self.all_bounds)


class Searched(NamedTuple):
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

    @property
    def lost(self) -> Float[np.ndarray, " cells"]:
        """The times [s] that are lost in the cells, because their limits are tightened."""
        return np.zeros(self.grid.cells) if self.found.lost is None else self.found.lost

    def times(self) -> Float[np.ndarray, " cells"]:
        """Return the times in the cells [s] as known numbers."""
        return np.diff(np.asarray(Timing(self.powers, constants(self.knots), self.rest).times))


class Drafted(NamedTuple):
    """The first search on a grid, the knots of the timing, whether u̇² is zero at its ends, and the times in its cells.

    Its timing satisfies the limits only at the nodes.
    """

    grid: Grid
    draft: Draft
    knots: Float[Any, " cells+1"]
    rest: tuple[bool, bool]
    in_cells: Float[np.ndarray, " cells"]

    @property
    def powers(self) -> Float[np.ndarray, "cells 4"]:
        """The coefficients of u̇² in each cell."""
        return self.draft.powers

    @property
    def lost(self) -> Float[np.ndarray, " cells"]:
        """The times [s] that are lost in the cells as soon as the limits hold between the nodes, too."""
        return self.draft.lost

    @property
    def error(self) -> float:
        """The relative optimality error; NaN or infinite if the search failed."""
        return float(self.draft.result.error)

    def times(self) -> Float[np.ndarray, " cells"]:
        """Return the times in the cells [s]."""
        return self.in_cells

    def completed(self, jerk: bool, rough: Rough = NOT_ROUGH) -> Searched:
        """Return the result of all searches, which may be `rough`; `jerk` is whether the jerk is limited."""
        enough = last_gap(self.draft.tables.grid.cells, jerk)
        return Searched(self.grid, completed(self.draft, rough), self.knots, enough, self.rest)


def searched(p: Posed, part: Part, grid: Grid, ends: Any, rest: tuple[bool, bool]) -> Searched:
    """Search for the fastest timing on a grid."""
    problem, t, knots = _problem(p, part, grid, ends, rest)
    return Searched(grid, fastest(problem, t), knots, last_gap(t.grid.cells, p.limits_jerk), rest)


def first_search(
    p: Posed,
    part: Part,
    grid: Grid,
    ends: Any,
    rest: tuple[bool, bool],
    before: Drafted | Searched | None = None,
    rough: Rough = NOT_ROUGH,
) -> Drafted:
    """Return the first search on a grid, which starts from the timing `before` on cells that `grid` divides.

    It ends at the optimality error `rough.draft`.
    """
    problem, t, knots = _problem(p, part, grid, ends, rest)
    first = None
    if before is not None:
        scale = grid.knots[-1] / before.grid.knots[-1]
        first = inserted(t.grid.knots, before.powers, before.grid.knots * scale, p.lap)
    draft = drafted(problem, t, first, rough)
    return Drafted(grid, draft, knots, rest, np.diff(np.asarray(Timing(draft.powers, knots, rest).times)))


def _problem(
    p: Posed, part: Part, grid: Grid, ends: Any, rest: tuple[bool, bool]
) -> tuple[Problem, Tables, Float[Any, " cells+1"]]:
    """Return the problem, its tables, and the knots as parameters of the path."""
    span: Any = [x if is_traced(x) else np.asarray(x) for x in part[:2]]
    start, end = span
    joint = np.diff(grid.segment) > 0
    smooth = np.full(grid.cells - 1, 2)
    smooth[joint] = part.smooth[grid.segment[:-1][joint] - part.first]
    problem = Problem(p.path, start, end, p.bounds, ends, p.vehicle, np.array(part.stops), p.others, p.held)
    fixed = p.held[0] is not None, p.held[1] is not None
    return problem, tables(grid, rest, p.lap, smooth, fixed), start + grid.knots * ((end - start) / grid.knots[-1])


def shape_of(path: AbstractHodograph, part: Part, others: Sequence[AbstractHodograph] = ()) -> Shape:
    """Return the derivatives of a part of a path with concrete values, with the components of all `others`, too."""
    if others:
        shapes = [shape_of(x, part) for x in (path, *others)]
        return shapes[0]._replace(
            derivatives=lambda i, place: np.concatenate([x.derivatives(i, place) for x in shapes], axis=1)
        )
    if isinstance(path, Route):
        segments = known_segments(path).part(slice(part.first, part.last))

        def of_route(i: np.ndarray, place: np.ndarray) -> np.ndarray:
            return segments.derivatives(i, 0.5 * segments.durations[i] * (1 + place), 3)

        return Shape(of_route, segments.durations, segments.starts)
    duration = float(np.asarray(path.duration))

    def of_any(_: np.ndarray, place: np.ndarray) -> np.ndarray:
        found = np.asarray(path_derivatives(path, 0.5 * duration * (1 + place.ravel())))
        return found.reshape(3, 3, *place.shape)

    return Shape(of_any, np.array([duration]), np.zeros(1))


def task_of(p: Posed, ends: Any, part: Part, rest: tuple[bool, bool], shape: Shape) -> Task:
    """Return the limits, and the largest squared speeds at both ends."""
    r1 = shape.derivatives(np.array([0, shape.spans.size - 1]), np.array([-1.0, 1.0]))[0]
    at_rest = np.array(rest) | np.array(part.stops)
    squares = np.where(at_rest, 0.0, np.asarray(ends)) * np.sum(r1 * r1, axis=0)
    most = float(squares[0]), float(squares[1])
    first, *others = ({name: _known(x) for name, x in bounds.items()} for bounds in p.all_bounds)
    return Task(first, p.vehicle, most, p.lap, tuple(others))


def _known(bound: Any) -> Any:
    return bound if isinstance(bound, Varying | OfSpeed) else np.asarray(bound)
