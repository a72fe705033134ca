"""Compute the fastest timing on a grid of cells: repeat the search with tighter limits where they are exceeded."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Bool, Float, Int

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
from qtraj.design.timing.grid import Shape, derivatives
from qtraj.design.timing.initial import initial
from qtraj.design.timing.interior_point import Program, begun, continued, solve
from qtraj.design.timing.on_host import on_host
from qtraj.design.timing.road import ROAD, slowing, without
from qtraj.design.timing.sensitivity import Optimum, duration_change, optimum
from qtraj.design.timing.sided import reduced
from qtraj.design.timing.spline import ORDERS, local, within_cells
from qtraj.design.timing.tables import CHECKED, Tables
from qtraj.foundation.arrays import constants, is_traced
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.vehicle import RoadParameters

GAPS = (1e-5, 1e-8)
"""Relative optimality errors at the end of the first search and of all further searches."""

FINEST = 128
"""With more cells than this, the allowed error of the last search grows with the square of the number of cells, because
rounding errors in the jerk prevent an optimality error of 1e-8."""

LARGEST_GAP = 1e-6
"""Largest allowed error of the last search without a limit on the jerk."""

ROUNDS, ALLOWED = 10, 8e-6
"""Maximum number of searches, and the relative violation between nodes up to which no further search is needed."""

OVER = 2.0
"""After a search, limits are tightened by `OVER` times the relative violation at `CHECKED` points of each cell. From
the fourth search on, this factor doubles after each search, because a peak far from the nodes decreases only if the
limits at the nodes become much tighter."""

MARGIN = 1e-5
"""Fraction by which all limits are reduced in the search, because they are imposed only at nodes."""

SLOWED = 1e-4
"""If a = u̇² is reduced by more than this fraction after the last search, the change of the duration is an error."""


class Problem(NamedTuple):
    """A part of a path from `start` to `end`, the given limits by name, and the bounds `ends` on a = u̇² at both ends.

    `vehicle` is None without limits on friction or power. `stops` indicates whether the velocity of the path is zero at
    the start and at the end.
    """

    path: AbstractHodograph
    start: Scalar
    end: Scalar
    bounds: dict[str, Scalar]
    ends: Float[Any, " 2"]
    vehicle: RoadParameters | None = None
    stops: Any = np.zeros(2, bool)


class Found(NamedTuple):
    """The fastest timing of a path on its cells.

    `powers` (cells, 4) are the coefficients of a = u̇² for ascending powers of the position in each cell. `usage`
    (limits, cells) is the largest ratio of each quantity to its limit, in the order of `listed`. `sensitivity` has the
    value zero and the derivatives of the minimum duration. `steps` is the number of steps of all searches, and `error`
    the optimality error of the last search. `unbounded` indicates whether no limit
    bounds the speed.
    """

    powers: Float[Any, "cells 4"]
    usage: Float[Any, "limits cells"]
    sensitivity: Scalar
    steps: Any
    error: Scalar
    unbounded: Any


def last_gap(cells: int, jerk: bool) -> float:
    """Return the relative optimality error at which the last search ends; `jerk` is whether the jerk is limited."""
    return min(GAPS[-1] * max(1.0, (cells / FINEST) ** 2), np.inf if jerk else LARGEST_GAP)


def fastest(problem: Problem, t: Tables, start: Float[np.ndarray, " cells+3"] | None = None) -> Found:
    """Compute the fastest timing; `powers` and `sensitivity` have derivatives with respect to the path and limits.

    `start` are the coefficients of the first iterate, by default those of `initial`. The search runs in NumPy. For a
    traced problem, it is one operation of JAX.
    """
    names, search = tuple(problem.bounds), functools.partial(_searched, t, problem.stops, start)
    if not is_traced(problem):
        with np.errstate(all="ignore"):  # a failed search ends with NaN
            program, places = _imposed(problem, t)
            r = on_host(search, _shapes(program, places), program[1:], places)
            powers, usage, error = _satisfied(r, r.coefficients, t, places, names)
        zero: Any = np.zeros(())
        return Found(powers[t.filled], usage[:, t.filled], zero, r.steps, error, r.unbounded)
    program, places = eqx.filter_jit(_imposed)(problem, t)
    r = on_host(search, _shapes(program, places), *constants((program[1:], places)))
    best, sensitivity = _differentiable(program, r)
    powers, usage, error = eqx.filter_jit(_satisfied)(r, best, t, stop_gradient(places), names)
    return Found(powers[t.filled], usage[:, t.filled], sensitivity, r.steps, error, r.unbounded)


class Result(NamedTuple):
    """The result of all searches.

    The fields up to `error` are those of the last `State`. The last search divided the limits by the factors `used`.
    `usage` is the largest result of `constraints.used` in each cell.
    """

    coefficients: Float[Any, "*batch cells+3"]
    slacks: Float[Any, "*batch count 2 cells+1"]
    multipliers: Float[Any, "*batch count 2 cells+1"]
    steps: Int[Any, "*batch"]
    error: Float[Any, "*batch"]
    used: Float[Any, "*batch count cells"]
    usage: Float[Any, "*batch limits cells"]
    unbounded: Bool[Any, "*batch"]


def _imposed(problem: Problem, t: Tables) -> tuple[Program, Parts]:
    """Return the problem with the limits at the nodes, and the limits at the points at which they are checked."""
    cells, grid = t.grid.cells, t.grid
    xp: Any = jnp if is_traced(problem) else np
    count = 2 * (cells + 1)
    shape = Shape(problem.path, problem.start, (problem.end - problem.start) / grid.knots[-1])
    r = derivatives(shape, grid, t.cell, t.place)
    bounds = reduced(problem.bounds, MARGIN)
    found = parts(r, shape.per_cell, bounds, problem.vehicle, t.cell >= cells // 2)
    imposed: Parts = jax.tree.map(lambda x: x[..., :count].reshape(*x.shape[:-1], 2, cells + 1), found)
    between: Parts = jax.tree.map(lambda x: x[..., count:].reshape(*x.shape[:-1], CHECKED, cells), found)
    r1 = r[0, :, :count].reshape(3, 2, cells + 1)
    fixed = r1, problem.end - problem.start, bounds, problem.ends, problem.vehicle
    most = largest(*(stop_gradient(fixed) if xp is jnp else fixed))
    c = imposed.constraints(most)
    ends = np.zeros((2, cells + 1), bool), np.zeros((2, cells + 1), bool)
    ends[0][0, 0] = ends[1][0, cells] = True
    upper = c.upper
    for end, bound in zip(ends, problem.ends, strict=True):
        upper = xp.where(end, xp.maximum(upper, 1 / bound), upper)
    padding = ~t.nodes.basis.any(axis=(0, 1))  # these nodes do not exist
    forms, sides = (xp.where(xp.broadcast_to(padding, x.shape), 0.0, x) for x in (c.forms, c.sides))
    jerk = c.jerk
    if jerk is not None:
        jerk = xp.where(xp.broadcast_to(t.nodes.standing > 0, jerk.shape), 0.0, jerk)
    on_road = None if c.road is None else without(c.road, padding)
    return Program(
        t.nodes, t.nodes.weight * shape.per_cell, Constraints(upper, forms, sides, jerk, on_road), most
    ), between


def _shapes(program: Program, places: Parts) -> Result:
    """Return the shapes and types of the result of a search for one problem."""
    (cells, count), dtype = (program.largest.shape[-1] - 1, program.constraints.per_node), program.weights.dtype
    nodes, limits = (count, 2, cells + 1), places.upper.shape[0] + count - 1
    of_type = [(cells + 3,), nodes, nodes, jnp.int32, (), (count, cells), (limits, cells), bool]
    return Result(
        *(jax.ShapeDtypeStruct(x, dtype) if isinstance(x, tuple) else jax.ShapeDtypeStruct((), x) for x in of_type)
    )


def _searched(t: Tables, stops: Bool[Any, " 2"], start: Any, of_nodes: tuple[Any, ...], between: Parts) -> Result:
    """Repeat the search for a batch of problems until the limits are satisfied between the nodes, too.

    `of_nodes` contains the fields of `Program` after the nodes. The batch axis of the arguments is the first axis.
    """
    of_nodes, between = jax.tree.map(lambda x: np.ascontiguousarray(np.moveaxis(x, 0, -3)), (of_nodes, between))
    program, within = Program(t.nodes, *of_nodes), t.within
    cells, count = within.shape[-1], program.constraints.per_node
    with np.errstate(all="ignore"):  # a failed search ends with NaN
        state = begun(program, initial(program) if start is None else start[None])
        size = len(state.steps)
        factors = np.ones((count, size, cells))
        used, usage = factors.copy(), np.zeros((between.upper.shape[0] + count - 1, size, cells))
        which, own, places = np.arange(size), program, between
        for search in range(ROUNDS):
            imposed = own._replace(constraints=tightened(own.constraints, _at_nodes(factors[:, which])))
            enough = np.full(which.size, GAPS[0] if search == 0 else last_gap(cells, own.constraints.jerk is not None))
            last = solve(imposed, continued(imposed, state.chosen(which)), enough)
            state.store(which, last)
            found = _between_nodes(places, within, last.coefficients)
            used[:, which], usage[:, which] = factors[:, which], found
            excess, over = _grouped(places, found), OVER * 2.0 ** max(search - 2, 0)
            excess = np.where((last.error < enough)[:, None], excess, 1.0)  # such violations mean nothing
            factors[:, which] *= np.where(excess > 1, 1 + over * (excess - 1), 1.0)
            if search + 1 < len(GAPS):
                continue
            goes_on = (found.max(axis=(0, 2)) > 1 + ALLOWED) & np.isfinite(last.error)
            if not goes_on.all():
                which, own = which[goes_on], own.chosen(goes_on)
                places = jax.tree.map(lambda x, goes_on=goes_on: x[..., goes_on, :, :], places)
            if not which.size:
                break
        free = unbounded(program, program.at_nodes(state.coefficients)[0], stops)
    nodes = (np.moveaxis(x, 1, 0) for x in (*state[1:3], used, usage))
    slack, multiplier, used, usage = nodes
    return Result(state.coefficients, slack, multiplier, *state[3:], used, usage, free)


def _satisfied(r: Result, best: Any, t: Tables, between: Parts, names: tuple[str, ...]) -> tuple[Any, Any, Any]:
    """Return the coefficients of a = u̇², the usage, and the error; slow down the timing if a violation remains.

    `best` are the coefficients of the last search, with their derivatives.

    A violation that a slower timing does not reduce remains, and the certificate reports it.
    """
    xp = namespace(best, r.usage)
    rows, on_road = listed(names, between.road is not None), slice(-len(ROAD), None)
    if between.road is None:
        slower = 1 / xp.maximum(xp.max(_grouped(between, r.usage)), 1.0)
    else:
        at_rest = _between_nodes(between, t.within, xp.zeros_like(r.coefficients))
        slower = 1 / xp.maximum(xp.max(_grouped(between, r.usage)[: -len(ROAD)]), 1.0)
        slower = xp.minimum(slower, xp.min(slowing(r.usage[on_road], at_rest[on_road], ALLOWED)))
    slower = xp.where(slower < 1 / (1 + ALLOWED), slower, 1.0)
    slowed = slower * r.coefficients
    powers = xp.einsum("pkn,kn->np", t.powers, local(slower * best))
    error = r.error + xp.where(slower >= 1 - SLOWED, 0.0, 0.5 * (1 - slower))  # the duration changes by half as much
    if between.road is None:
        factors = [slower if name in UPPER else slower ** POWERS.get(name, 0.0) for name in rows]
        usage = r.usage * xp.stack(factors)[:, None]
    else:  # friction and power do not scale with a power of `slower`
        usage = _between_nodes(between, t.within, slowed)
    return powers, ratios(usage, rows), error


def _between_nodes(between: Parts, within: np.ndarray, coefficients: Any) -> Float[Any, "limits *batch cells"]:
    """Return the maxima of `used` in each cell, from samples and parabolas through them."""
    xp = namespace(coefficients, between.upper)
    rows = used(between, within_cells(within, coefficients, 2 if between.jerk is None else ORDERS))
    before, at, after = rows[..., :-2, :], rows[..., 1:-1, :], rows[..., 2:, :]
    bend, change = 2 * at - before - after, after - before
    peak = (bend > 0) & (xp.abs(change) <= 2 * bend)  # the vertex is between the three samples
    rise = xp.where(peak, change**2 / (8 * xp.where(peak, bend, 1.0)), 0.0)
    return xp.maximum(xp.max(rows, axis=-2), xp.max(at + rise, axis=-2))


def _grouped(between: Parts, rows: Float[Any, "limits *batch cells"]) -> Float[Any, "count *batch cells"]:
    """Return the usage of each constraint; the upper bounds on a are one constraint."""
    xp, count = namespace(rows), between.upper.shape[0]
    return xp.concatenate([xp.max(rows[:count], axis=0, initial=0.0)[None], rows[count:]])


def _at_nodes(factors: Float[Any, "count *batch cells"]) -> Float[Any, "count *batch 2 cells+1"]:
    """Return the factors at the nodes; a knot has the larger factor of its two cells."""
    xp = namespace(factors)
    one = xp.ones_like(factors[..., :1])
    before, after = xp.concatenate([one, factors], axis=-1), xp.concatenate([factors, one], axis=-1)
    return xp.stack([xp.maximum(before, after), after], axis=-2)


@eqx.filter_jit
def _differentiable(program: Program, r: Result) -> tuple[Float[Any, " cells+3"], Scalar]:
    """Return the coefficients of the last search as a differentiable function of the path and the limits.

    The second result has the value zero and the derivatives of the minimum duration.
    """
    imposed = program._replace(constraints=tightened(program.constraints, _at_nodes(r.used)))
    at = Optimum(r.coefficients, r.slacks, r.multipliers)
    return optimum(imposed, at).coefficients, duration_change(imposed, at)
