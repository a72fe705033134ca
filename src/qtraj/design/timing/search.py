"""Compute the fastest timing on a grid of cells: repeat the search with tighter limits where they are exceeded."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Float

from qtraj.design.on_host import on_host
from qtraj.design.timing.bodies import joined, rows_of
from qtraj.design.timing.boundedness import largest
from qtraj.design.timing.constraint_values import ratios, tightened
from qtraj.design.timing.constraints import POWERS, UPPER, Constraints, Parts, parts
from qtraj.design.timing.grid import Shape, derivatives
from qtraj.design.timing.program import Program
from qtraj.design.timing.road import ROAD, slowing, without
from qtraj.design.timing.road_cells import at_points, fixed
from qtraj.design.timing.rounds import (
    ALLOWED,
    NOT_ROUGH,
    Result,
    Rough,
    at_nodes,
    between_nodes,
    grouped,
    lost,
    searched,
    shapes,
)
from qtraj.design.timing.sensitivity import Optimum, duration_change, optimum
from qtraj.design.timing.sided import reduced
from qtraj.design.timing.spline import local
from qtraj.design.timing.tables import CHECKED, Tables
from qtraj.design.varying import at_places, in_cells, strictest, varies
from qtraj.foundation.arrays import constants, is_traced
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters

MARGIN = 1e-5
"""Fraction by which all limits are reduced in the search, because they are imposed only at nodes."""

SLOWED = 1e-4
"""If a = u̇² is reduced by more than this fraction after the last search, the change of the duration is an error."""


class Problem(NamedTuple):
    """A part of a path from `start` to `end`, the given limits by name, and the bounds `ends` on a = u̇² at both ends.

    `vehicle` is None without limits on friction or power. `stops` indicates whether the velocity of the path is zero at
    the start and at the end. `others` are the paths and the limits of further bodies with the same timing. `held` are
    the values of a at the ends where it is prescribed, otherwise None; a traced problem has none.
    """

    path: AbstractHodograph
    start: Scalar
    end: Scalar
    bounds: dict[str, Any]
    ends: Float[Any, " 2"]
    vehicle: RoadParameters | RoadOnPath | None = None
    stops: Any = np.zeros(2, bool)
    others: tuple[tuple[AbstractHodograph, dict[str, Any]], ...] = ()
    held: tuple[float | None, float | None] = (None, None)

    @property
    def rows(self) -> tuple[str, ...]:
        """The names of the limits in the order of the rows of arrays."""
        return rows_of([self.bounds, *(bounds for _, bounds in self.others)], self.vehicle is not None)


class Found(NamedTuple):
    """The fastest timing of a path on its cells.

    `powers` (cells, 4) are the coefficients of a = u̇² for ascending powers of the position in each cell. `usage`
    (limits, cells) is the largest ratio of each quantity to its limit, in the order of `listed`. `sensitivity` has the
    value zero and the derivatives of the minimum duration. `steps` is the number of steps of all searches, and `error`
    the optimality error of the last search. `unbounded` indicates whether no limit bounds the speed. `lost` (cells,) is
    the time [s] that is lost in each cell, because its limits are tightened; None for a traced problem.
    """

    powers: Float[Any, "cells 4"]
    usage: Float[Any, "limits cells"]
    sensitivity: Scalar
    steps: Any
    error: Scalar
    unbounded: Any
    lost: Float[np.ndarray, " cells"] | None = None


def fastest(problem: Problem, t: Tables, start: Float[np.ndarray, " cells+3"] | None = None) -> Found:
    """Compute the fastest timing; `powers` and `sensitivity` have derivatives with respect to the path and limits.

    `start` are the coefficients of the first iterate, by default those of `initial`. The search runs in NumPy. For a
    traced problem, it is one operation of JAX.
    """
    if not is_traced(problem):
        return completed(drafted(problem, t, start))
    search = functools.partial(searched, t, problem.stops, start)
    program, places = eqx.filter_jit(_imposed)(problem, t)
    r = on_host(search, shapes(program, places), *constants((program[1:], places)))
    best, sensitivity = _differentiable(program, r)
    powers, usage, error = eqx.filter_jit(_satisfied)(r, best, t, stop_gradient(places), problem.rows)
    return Found(powers[t.filled], usage[:, t.filled], sensitivity, r.steps, error, r.unbounded)


class Draft(NamedTuple):
    """The result of the first search, which satisfies the limits only at the nodes, and what it needs to go on."""

    problem: Problem
    tables: Tables
    program: Program
    places: Parts
    result: Result

    @property
    def lost(self) -> Float[np.ndarray, " cells"]:
        """The times [s] that are lost in the cells as soon as the limits hold between the nodes, too."""
        return lost(self.places, self.result)[self.tables.filled]

    @property
    def powers(self) -> Float[np.ndarray, "cells 4"]:
        """The coefficients of a = u̇² in each cell."""
        powers = np.einsum("pkn,kn->np", self.tables.within.powers, local(self.result.coefficients))
        return powers[self.tables.filled]


def drafted(
    problem: Problem, t: Tables, start: Float[np.ndarray, " cells+3"] | None = None, rough: Rough = NOT_ROUGH
) -> Draft:
    """Compute the first search of `fastest` for a problem with concrete values; it may be `rough`."""
    with np.errstate(all="ignore"):  # a failed search ends with NaN
        program, places = _imposed(problem, t)
        search = functools.partial(searched, t, problem.stops, start, rounds=1, held=problem.held, rough=rough)
        return Draft(problem, t, program, places, on_host(search, shapes(program, places), program[1:], places))


def completed(d: Draft, rough: Rough = NOT_ROUGH) -> Found:
    """Compute all further searches after a draft; they may be `rough`."""
    with np.errstate(all="ignore"):
        search = functools.partial(searched, d.tables, d.problem.stops, d.result, held=d.problem.held, rough=rough)
        return _found(d, on_host(search, shapes(d.program, d.places), d.program[1:], d.places))


def _found(d: Draft, r: Result) -> Found:
    powers, usage, error = _satisfied(r, r.coefficients, d.tables, d.places, d.problem.rows)
    zero, filled = np.zeros(()), d.tables.filled
    sensitivity: Any = zero
    return Found(powers[filled], usage[:, filled], sensitivity, r.steps, error, r.unbounded, lost(d.places, r)[filled])


def _imposed(problem: Problem, t: Tables) -> tuple[Program, Parts]:
    """Return the problem with the limits at the nodes, and the limits at the points at which they are checked."""
    cells, grid = t.grid.cells, t.grid
    xp: Any = jnp if is_traced(problem) else np
    count = 2 * (cells + 1)
    shape = Shape(problem.path, problem.start, (problem.end - problem.start) / grid.knots[-1])
    r = derivatives(shape, grid, t.cell, t.place)
    given = problem.bounds
    if varies(given):
        given = _at_points(given, t, shape)
    bounds = reduced(given, MARGIN)
    vehicle = at_points(problem.vehicle, t, shape)
    found = joined([parts(r, shape.per_cell, bounds, vehicle, t.cell >= cells // 2), *_of_others(problem, t, shape)])
    imposed: Parts = jax.tree.map(lambda x: x[..., :count].reshape(*x.shape[:-1], 2, cells + 1), found)
    between: Parts = jax.tree.map(lambda x: x[..., count:].reshape(*x.shape[:-1], CHECKED, cells), found)
    r1 = r[0, :, :count].reshape(3, 2, cells + 1)
    sizes = reduced(strictest(problem.bounds), MARGIN)
    given = r1, problem.end - problem.start, sizes, problem.ends, fixed(problem.vehicle)
    most = largest(*(stop_gradient(given) if xp is jnp else given))
    for path, own in problem.others:
        r1 = derivatives(shape._replace(path=path), grid, t.cell, t.place)[0, :, :count].reshape(r1.shape)
        given = r1, given[1], reduced(own, MARGIN), *given[3:]
        most = xp.minimum(most, largest(*(stop_gradient(given) if xp is jnp else given)))
    c = imposed.constraints(most)
    ends = np.zeros((2, cells + 1), bool), np.zeros((2, cells + 1), bool)
    ends[0][0, 0] = ends[1][0, cells] = True
    upper = c.upper
    for end, bound, held in zip(ends, problem.ends, problem.held, strict=True):
        upper = xp.where(end, xp.maximum(upper, 1 / bound), upper) if held is None else upper
    padding = ~t.nodes.basis.any(axis=(0, 1))  # these nodes do not exist
    forms, sides = (xp.where(xp.broadcast_to(padding, x.shape), 0.0, x) for x in (c.forms, c.sides))
    jerk = c.jerk
    if jerk is not None:
        jerk = xp.where(xp.broadcast_to(t.nodes.standing > 0, jerk.shape), 0.0, jerk)
    on_road = None if c.road is None else without(c.road, padding)
    bends = None if c.bends is None else c.bends.scaled(~padding)
    combined = None if c.combined is None else c.combined.without(padding)
    formulas = None if c.formulas is None else c.formulas.without(padding)
    c = Constraints(upper, forms, sides, jerk, on_road, bends, combined, formulas)
    return Program(t.nodes, t.nodes.weight * shape.per_cell, c, most), between


def _of_others(problem: Problem, t: Tables, shape: Shape) -> list[Parts]:
    """Return the limits of the other bodies, which may be at rest at any knot."""
    return [
        parts(
            derivatives(shape._replace(path=path), t.grid, t.cell, t.place),
            shape.per_cell,
            reduced(bounds, MARGIN),
            None,
            t.place > 0.5,
        )
        for path, bounds in problem.others
    ]


def _at_points(bounds: dict[str, Any], t: Tables, shape: Shape) -> dict[str, Any]:
    """Return the limits at all points; at a knot the stricter one of both cells that it joins."""
    u = np.asarray(shape.start + t.grid.knots * shape.per_cell)
    lines = in_cells(bounds, u[:-1], u[1:])
    found = at_places(lines, t.cell, t.place)
    for name, line in lines.items():
        if np.ndim(line):
            side, knots = quantity(name).side, slice(1, t.grid.cells)
            found[name][knots] = side * np.minimum(side * found[name][knots], side * line[:-1, 1])
    return found


def _satisfied(r: Result, best: Any, t: Tables, between: Parts, rows: tuple[str, ...]) -> tuple[Any, Any, Any]:
    """Return the coefficients of a = u̇², the usage, and the error; slow down the timing if a violation remains.

    `best` are the coefficients of the last search, with their derivatives, and `rows` the names of the limits.

    A violation that a slower timing does not reduce remains, and the certificate reports it.
    """
    xp = namespace(best, r.usage)
    on_road = slice(-len(ROAD), None)
    if between.road is None:
        slower = 1 / xp.maximum(xp.max(grouped(between, r.usage)), 1.0)
    else:
        at_rest = between_nodes(between, t.within, xp.zeros_like(r.coefficients))
        slower = 1 / xp.maximum(xp.max(grouped(between, r.usage)[: -len(ROAD)]), 1.0)
        slower = xp.minimum(slower, xp.min(slowing(r.usage[on_road], at_rest[on_road], ALLOWED)))
    slower = xp.where(slower < 1 / (1 + ALLOWED), slower, 1.0)
    slowed = slower * r.coefficients
    powers = xp.einsum("pkn,kn->np", t.within.powers, local(slower * best))
    error = r.error + xp.where(slower >= 1 - SLOWED, 0.0, 0.5 * (1 - slower))  # the duration changes by half as much
    by_speed = between.bends is not None or between.combined is not None
    if between.road is None and not by_speed:
        factors = [slower if name in UPPER else slower ** POWERS.get(name, 0.0) for name in rows]
        usage = r.usage * xp.stack(factors)[:, None]
    else:  # friction, power and limits by speed do not scale with a power of `slower`
        usage = between_nodes(between, t.within, slowed)
    return powers, ratios(usage, rows), error


@eqx.filter_jit
def _differentiable(program: Program, r: Result) -> tuple[Float[Any, " cells+3"], Scalar]:
    """Return the coefficients of the last search as a differentiable function of the path and the limits.

    The second result has the value zero and the derivatives of the minimum duration.
    """
    imposed = program._replace(constraints=tightened(program.constraints, at_nodes(r.used)))
    at = Optimum(r.coefficients, r.slacks, r.multipliers)
    return optimum(imposed, at).coefficients, duration_change(imposed, at)
