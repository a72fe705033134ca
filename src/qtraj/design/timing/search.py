"""Compute the fastest timing on a grid of cells: repeat the search with tighter limits where they are exceeded."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float, Int

from qtraj.design.timing.banded import total
from qtraj.design.timing.boundedness import largest, unbounded
from qtraj.design.timing.constraints import (
    POWERS,
    UPPER,
    Constraints,
    Parts,
    listed,
    parts,
    ratios,
    tightened,
    used,
)
from qtraj.design.timing.grid import Grid, Shape, derivatives
from qtraj.design.timing.initial import initial
from qtraj.design.timing.interior_point import Program, State, begun, continued, solve
from qtraj.design.timing.road import ROAD, slowing, without
from qtraj.design.timing.sensitivity import Optimum, duration_change, optimum
from qtraj.design.timing.spline import DEGREE, ORDERS, Nodes, local, nodes, power_form, within
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.vehicle import RoadParameters

GAPS = (1e-5, 1e-8)
"""Relative optimality errors at the end of the first search and of all further searches."""

FINEST = 128
"""With more cells than this, the allowed error of the last search grows with the square of the number of cells, because
rounding errors in the jerk prevent an optimality error of 1e-8."""

ROUNDS, ALLOWED = 10, 8e-6
"""Maximum number of searches, and the relative violation between nodes up to which no further search is needed."""

OVER, CHECKED = 2.0, 17
"""After a search, limits are tightened by `OVER` times the relative violation at `CHECKED` points of each cell. From
the fourth search on, this factor doubles after each search, because a peak far from the nodes decreases only if the
limits at the nodes become much tighter."""

MARGIN = 1e-5
"""Fraction by which all limits are reduced in the search, because they are imposed only at nodes."""

SLOWED = 1e-4
"""If a = u̇² must be reduced by more than this fraction after the last search, the search has not converged."""


class Problem(NamedTuple):
    """A part of a path from `start` to `end`, the given limits by name, and the bounds `ends` on a = u̇² at both ends.

    `vehicle` is None without limits on friction or power. `stops` indicates whether the velocity of the path is zero at
    the start and at the end.
    """

    path: AbstractHodograph
    start: Scalar
    end: Scalar
    bounds: dict[str, Scalar]
    ends: Float[Array, " 2"]
    vehicle: RoadParameters | None = None
    stops: Any = np.zeros(2, bool)


class Tables(NamedTuple):
    """Data that depend only on the cells: the grid, its nodes, and the values of the spline within each cell.

    For each node, and then for each point at which limits are checked, `cell` is the index of its cell and `place` its
    position in the cell, between 0 and 1. `within` and `powers` are the results of the functions `within` and
    `power_form` of the module `spline`.
    """

    grid: Grid
    nodes: Nodes
    cell: Int[np.ndarray, " all"]
    place: Float[np.ndarray, " all"]
    within: Float[np.ndarray, "places 3 4 cells"]
    powers: Float[np.ndarray, "4 4 cells"]


class Found(NamedTuple):
    """The fastest timing of a path on its cells.

    `powers` (cells, 4) are the coefficients of a = u̇² for ascending powers of the position in each cell. `usage`
    (limits, cells) is the largest ratio of each quantity to its limit, in the order of `listed`. `sensitivity` has the
    value zero and the derivatives of the minimum duration. `steps` is the number of steps of all searches, and `error`
    the optimality error of the last search. `unbounded` indicates whether no limit bounds the speed.
    """

    powers: Float[Array, "cells 4"]
    usage: Float[Array, "limits cells"]
    sensitivity: Scalar
    steps: Array
    error: Scalar
    unbounded: Array


def last_gap(cells: int) -> float:
    """Return the relative optimality error at which the last search ends."""
    return GAPS[-1] * max(1.0, (cells / FINEST) ** 2)


def tables(grid: Grid, rest: tuple[bool, bool], jerk: bool = False) -> Tables:
    """Return the tables of a grid.

    `rest` indicates whether the vehicle is at rest at the start and at the end, and `jerk` whether the jerk is limited.
    The jerk may jump where one segment ends and the next one starts, so nodes are placed on both sides of this knot.
    """
    return _tables(tuple(tuple(x.tolist()) for x in grid), rest, jerk)


@functools.lru_cache(maxsize=32)
def _tables(fields: tuple[tuple[float, ...], ...], rest: tuple[bool, bool], jerk: bool) -> Tables:
    knots, segment, middle, half = (np.array(x) for x in fields)
    jumps = np.append(np.diff(segment) != 0, False) if jerk else None
    grid, own, length = Grid(knots, segment, middle, half), nodes(knots, rest, jumps), np.diff(knots)
    columns = np.append(np.arange(length.size), length.size - 1)
    cell = np.concatenate([columns, columns, np.tile(np.arange(length.size), CHECKED)])
    at_nodes = ((own.place - knots[columns]) / length[columns]).ravel()
    place = np.concatenate([at_nodes, np.repeat(np.linspace(0.0, 1.0, CHECKED), length.size)])
    return Tables(grid, own, cell, place, within(knots, CHECKED), power_form(knots))


def fastest(problem: Problem, t: Tables) -> Found:
    """Compute the fastest timing; `powers` and `sensitivity` have derivatives with respect to the path and limits."""
    program, places = _imposed(problem, t)
    r = _searched(*stop_gradient((program, places)), t.within)
    best, sensitivity = _differentiable(program, r)
    powers, usage, error = _satisfied(r, best, t, stop_gradient(places), tuple(problem.bounds))
    fixed, a = stop_gradient(program), program.at_nodes(r.state.coefficients)[0]
    free = unbounded(fixed, a, problem.stops)
    return Found(powers, usage, sensitivity, r.state.steps, error, free)


class _Round(NamedTuple):
    """The result `state` of the last search, and the number of `searches`.

    The last search divided the limits by the factors `used`; the next search divides them by `factors`. `usage` is the
    largest result of `constraints.used` in each cell.
    """

    state: State
    used: Float[Array, "count cells"]
    factors: Float[Array, "count cells"]
    usage: Float[Array, "limits cells"]
    searches: Int[Array, ""]


@eqx.filter_jit
def _imposed(problem: Problem, t: Tables) -> tuple[Program, Parts]:
    """Return the problem with the limits at the nodes, and the limits at the points at which they are checked."""
    cells, grid = t.grid.cells, t.grid
    count, dtype = 2 * (cells + 1), problem.ends.dtype
    shape = Shape(problem.path, problem.start, (problem.end - problem.start) / cells)
    r = derivatives(shape, grid, t.cell, jnp.asarray(t.place, dtype))
    bounds = {name: bound * (1 - MARGIN) for name, bound in problem.bounds.items()}
    found = parts(r, shape.per_cell, bounds, problem.vehicle)
    imposed: Parts = jax.tree.map(lambda x: x[..., :count].reshape(*x.shape[:-1], 2, cells + 1), found)
    between: Parts = jax.tree.map(lambda x: x[..., count:].reshape(*x.shape[:-1], CHECKED, cells), found)
    nodes: Nodes = jax.tree.map(lambda x: jnp.asarray(x, dtype), t.nodes)
    r1 = stop_gradient(r[0, :, :count]).reshape(3, 2, cells + 1)
    most = largest(r1, problem.end - problem.start, *stop_gradient((bounds, problem.ends, problem.vehicle)))
    c = imposed.constraints(stop_gradient(most))
    upper = c.upper.at[0, 0].max(1 / problem.ends[0]).at[0, cells].max(1 / problem.ends[1])
    forms = tuple(x.at[..., 1, cells].set(0.0) for x in c.forms)  # padding: this node does not exist
    jerk = None if c.jerk is None else jnp.where(nodes.standing > 0, 0.0, c.jerk)
    padding = jnp.zeros(upper.shape, bool).at[1, cells].set(True)
    on_road = None if c.road is None else without(c.road, padding)
    constraints = Constraints(upper, forms, jerk, on_road)
    return Program(nodes, jnp.asarray(nodes.weight) * shape.per_cell, constraints, stop_gradient(most)), between


@eqx.filter_jit
def _searched(program: Program, between: Parts, within: Float[Any, "places 3 4 cells"]) -> _Round:
    """Repeat the search until the limits are satisfied between the nodes, too.

    The compiled code is the same for all classes of paths.
    """
    cells, dtype = within.shape[-1], program.weights.dtype
    gaps = jnp.asarray([GAPS[0], last_gap(cells)], dtype)

    def attempt(r: _Round) -> _Round:
        own = program._replace(constraints=tightened(program.constraints, _at_nodes(r.factors)))
        state = solve(own, continued(own, r.state), gaps[jnp.minimum(r.searches, 1)])
        found = _between_nodes(between, within, state.coefficients)
        excess = _grouped(between, found)
        over = OVER * 2.0 ** jnp.maximum(r.searches - 2, 0).astype(dtype)
        factors = r.factors * jnp.where(excess > 1, 1 + over * (excess - 1), 1.0)
        return _Round(state, r.factors, factors, found, r.searches + 1)

    def goes_on(r: _Round) -> Array:
        unsatisfied = (jnp.max(r.usage) > 1 + ALLOWED) & jnp.isfinite(r.state.error)
        return (r.searches < len(GAPS)) | (unsatisfied & (r.searches < ROUNDS))

    count = program.constraints.per_node
    ones, nothing = jnp.ones((count, cells), dtype), jnp.zeros((between.upper.shape[0] + count - 1, cells), dtype)
    start = _Round(begun(program, initial(program)), ones, ones, nothing, jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(goes_on, attempt, start)


@eqx.filter_jit
def _satisfied(r: _Round, best: Array, t: Tables, between: Parts, names: tuple[str, ...]) -> tuple[Array, Array, Array]:
    """Return the coefficients of a = u̇², the usage, and the error; slow down the timing if a violation remains.

    `best` are the coefficients of the last search, with their derivatives.

    A violation that a slower timing does not reduce remains, and the certificate reports it.
    """
    rows, on_road = listed(names, between.road is not None), slice(-len(ROAD), None)
    if between.road is None:
        slower = 1 / jnp.maximum(jnp.max(_grouped(between, r.usage)), 1.0)
    else:
        at_rest = _between_nodes(between, t.within, jnp.zeros_like(r.state.coefficients))
        slower = 1 / jnp.maximum(jnp.max(_grouped(between, r.usage)[: -len(ROAD)]), 1.0)
        slower = jnp.minimum(slower, jnp.min(slowing(r.usage[on_road], at_rest[on_road], ALLOWED)))
    slower = jnp.where(slower < 1 / (1 + ALLOWED), slower, 1.0)
    slowed = slower * r.state.coefficients
    powers = jnp.sum(jnp.asarray(t.powers, slower.dtype) * local(slower * best)[None], axis=1).T
    error = jnp.where(slower >= 1 - SLOWED, r.state.error, jnp.inf)
    if between.road is None:
        factors = [slower if name in UPPER else slower ** POWERS[name] for name in rows]
        usage = r.usage * jnp.stack(factors)[:, None]
    else:  # friction and power do not scale with a power of `slower`
        usage = _between_nodes(between, t.within, slowed)
    return powers, ratios(usage, rows), error


def _between_nodes(between: Parts, within: Any, coefficients: Array) -> Float[Array, "limits cells"]:
    """Return the maxima of `used` in each cell, from samples and parabolas through them."""
    orders = 2 if between.jerk is None else ORDERS
    own, table = local(coefficients), jnp.asarray(within, coefficients.dtype)
    v = [total(table[:, order, k] * own[k][None] for k in range(DEGREE + 1)) for order in range(orders)]
    rows = used(between, jnp.stack(v))
    before, at, after = rows[:, :-2], rows[:, 1:-1], rows[:, 2:]
    bend, change = 2 * at - before - after, after - before
    peak = (bend > 0) & (jnp.abs(change) <= 2 * bend)  # the vertex is between the three samples
    rise = jnp.where(peak, change**2 / (8 * jnp.where(peak, bend, 1.0)), 0.0)
    return jnp.maximum(jnp.max(rows, axis=1), jnp.max(at + rise, axis=1))


def _grouped(between: Parts, rows: Float[Array, "limits cells"]) -> Float[Array, "count cells"]:
    """Return the usage of each constraint; the upper bounds on a are one constraint."""
    count = between.upper.shape[0]
    return jnp.concatenate([jnp.max(rows[:count], axis=0, initial=0.0)[None], rows[count:]])


def _at_nodes(factors: Float[Array, "count cells"]) -> Float[Array, "count 2 cells+1"]:
    """Return the factors at the nodes; a knot has the larger factor of its two cells."""
    one = jnp.ones_like(factors[:, :1])
    before, after = jnp.concatenate([one, factors], axis=1), jnp.concatenate([factors, one], axis=1)
    return jnp.stack([jnp.maximum(before, after), after], axis=1)


@eqx.filter_jit
def _differentiable(program: Program, r: _Round) -> tuple[Float[Array, " cells+3"], Scalar]:
    """Return the coefficients of the last search as a differentiable function of the path and the limits.

    The second result has the value zero and the derivatives of the minimum duration.
    """
    imposed = program._replace(constraints=tightened(program.constraints, _at_nodes(r.used)))
    at = Optimum(r.state.coefficients, r.state.slacks, r.state.multipliers)
    return optimum(imposed, at).coefficients, duration_change(imposed, at)
