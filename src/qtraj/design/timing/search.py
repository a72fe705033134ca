"""The fastest timing on a grid of cells: interior-point searches, with limits tightened where cells exceed them."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float, Int

from qtraj.design.timing.constraints import COUNT, NAMES, UPPER, Constraints, Parts, parts, tightened, used, values
from qtraj.design.timing.grid import Grid, Shape, derivatives
from qtraj.design.timing.interior_point import Program, duration, solve
from qtraj.design.timing.spline import DEGREE, Nodes, at_nodes, local, nodes, power_form, within
from qtraj.foundation.types import Scalar

GAPS = ((1.0, 1e-2), (1e-2, 1e-5), (1e-4, 1e-8))
"""Relative duality gaps at the start and at the end of successive searches; all further searches use the last pair."""

FINEST = 128
"""With more cells the final gap grows with their squared number, because rounding errors in the jerk prevent 1e-8."""

ROUNDS, ALLOWED = 8, 2e-6
"""Maximum number of searches, and the relative excess of a limit between the nodes that ends them."""

OVER, CHECKED = 1.3, 17
"""Limits are tightened by `OVER` times the excess found at `CHECKED` places of each cell."""

SLOWED = 1e-4
"""A timing slower than the solution of the last search by more than this part of a has not converged."""

INSIDE, CLOSE = 0.9, 0.98
"""The initial values of the first and of later searches are scaled to this fraction of the largest feasible ones."""


class Problem(NamedTuple):
    """A path, its limits by name (infinite if absent), and the largest squared path speed at its ends."""

    shape: Shape
    bounds: dict[str, Scalar]
    ends: Float[Array, " 2"]


class Tables(NamedTuple):
    """Data that depend only on the cells: the grid, its nodes, and the values of the spline within each cell."""

    grid: Grid
    nodes: Nodes
    within: Float[np.ndarray, "places 3 4 cells"]
    powers: Float[np.ndarray, "4 4 cells"]


class Found(NamedTuple):
    """The fastest timing of a path on its cells.

    `powers` (cells, 4): the coefficients of the squared path speed in powers of the place in each cell. `usage`
    (limits, cells): the largest ratio of each quantity to its limit, in the order of `NAMES`. `sensitivity` has the
    value zero and the derivatives of the minimum duration. `steps` is the number of steps of all searches, `error` the
    error of the last search.
    """

    powers: Float[Array, "cells 4"]
    usage: Float[Array, "8 cells"]
    sensitivity: Scalar
    steps: Array
    error: Scalar


def last_gap(cells: int) -> float:
    """The relative duality gap at which the last search ends."""
    return GAPS[-1][1] * max(1.0, (cells / FINEST) ** 2)


def tables(grid: Grid, rest: tuple[bool, bool]) -> Tables:
    """The tables of a grid; `rest` says whether the vehicle is at rest at the start and at the end."""
    return Tables(grid, nodes(grid.knots, rest), within(grid.knots, CHECKED), power_form(grid.knots))


def fastest(problem: Problem, t: Tables) -> Found:
    """The fastest timing; `sensitivity` has derivatives with respect to the path and the limits."""
    program, places = _imposed(problem, t)
    r = _searched(*stop_gradient((program, places)), t.within)
    powers, usage, slower = _satisfied(r, stop_gradient(places), t)
    sensitivity = _sensitivity(program, r)
    return Found(powers, usage, sensitivity, r.steps, jnp.where(slower >= 1 - SLOWED, r.error, jnp.inf))


class _Round(NamedTuple):
    """The solution of the last search, the factors it `used` and those of the next, the usage, and counters."""

    coefficients: Float[Array, " cells+3"]
    multipliers: Float[Array, "5 nodes"]
    used: Float[Array, "5 cells"]
    factors: Float[Array, "5 cells"]
    usage: Float[Array, "8 cells"]
    searches: Int[Array, ""]
    steps: Int[Array, ""]
    error: Scalar


@eqx.filter_jit
def _imposed(problem: Problem, t: Tables) -> tuple[Program, Parts]:
    """The problem with the limits at the nodes, and the limits at places within the cells."""
    cells, grid = t.grid.cells, t.grid
    cell = np.concatenate([np.arange(cells), [cells - 1], np.arange(cells), np.tile(np.arange(cells), CHECKED)])
    count, dtype = 2 * cells + 1, problem.shape.per_cell.dtype
    knots, at, own = jnp.asarray(grid.knots), jnp.asarray(t.nodes.place), cell[:count]
    places = jnp.asarray(np.repeat(np.linspace(0.0, 1.0, CHECKED), cells), dtype)
    place = jnp.concatenate([(at - knots[own]) / (knots[own + 1] - knots[own]), places])
    r = derivatives(problem.shape, grid, cell, place)
    found = parts(r, problem.shape.per_cell, problem.bounds)
    imposed, between = Parts(*(x[..., :count] for x in found)), Parts(*(x[..., count:] for x in found))
    nodes: Nodes = jax.tree.map(lambda x: jnp.asarray(x, dtype), t.nodes)
    c = imposed.constraints()
    upper = c.upper.at[0].max(1 / problem.ends[0]).at[cells].max(1 / problem.ends[1])
    weights = jnp.asarray(nodes.weight) * problem.shape.per_cell
    return Program(nodes, weights, Constraints(upper, c.forms, jnp.where(nodes.standing > 0, 0.0, c.jerk))), between


@eqx.filter_jit
def _searched(program: Program, between: Parts, within: Float[Any, "places 3 4 cells"]) -> _Round:
    """Searches until the limits are satisfied between the nodes too; independent of the kind of path."""
    cells, dtype = program.nodes.inner.shape[-1], program.weights.dtype
    last = last_gap(cells)
    gaps = jnp.asarray([(a, max(b, last)) for a, b in GAPS], dtype)

    def attempt(r: _Round) -> _Round:
        begin, end = gaps[jnp.minimum(r.searches, len(GAPS) - 1)]
        own = program._replace(constraints=tightened(program.constraints, _at_nodes(r.factors)))
        part = _largest_part(own.constraints, at_nodes(own.nodes, r.coefficients))
        part = jnp.where(r.searches == 0, INSIDE * part, jnp.minimum(CLOSE * part, 1.0))
        state = solve(own, r.coefficients * part, (begin, end))
        usage = _between_nodes(between, within, state.coefficients)
        excess = _grouped(usage)
        factors = r.factors * jnp.where(excess > 1, 1 + OVER * (excess - 1), 1.0)
        counts = r.searches + 1, r.steps + state.steps
        return _Round(state.coefficients, state.multipliers, r.factors, factors, usage, *counts, state.error)

    def goes_on(r: _Round) -> Array:
        unsatisfied = (jnp.max(r.usage) > 1 + ALLOWED) & jnp.isfinite(r.error)
        return (r.searches < len(GAPS)) | (unsatisfied & (r.searches < ROUNDS))

    none, ones = jnp.zeros((), jnp.int32), jnp.ones((COUNT, cells), dtype)
    multipliers = jnp.zeros((COUNT, 2 * cells + 1), dtype)
    usage = jnp.zeros((len(NAMES), cells), dtype)
    infinite = jnp.full((), jnp.inf, dtype)
    start = _Round(_initial(program), multipliers, ones, ones, usage, none, none, infinite)
    return jax.lax.while_loop(goes_on, attempt, start)


@eqx.filter_jit
def _satisfied(r: _Round, between: Parts, t: Tables) -> tuple[Array, Array, Array]:
    """The powers of a, the usage, and a factor of a: a small remaining excess is removed by driving more slowly."""
    excess = jnp.max(_grouped(r.usage))
    slower = jnp.where(excess > 1 + ALLOWED, 1 / excess, 1.0)
    coefficients = r.coefficients * slower
    powers = jnp.sum(jnp.asarray(t.powers, coefficients.dtype) * local(coefficients)[None], axis=1).T
    return powers, _between_nodes(between, t.within, coefficients), slower


def _between_nodes(between: Parts, within: Any, coefficients: Array) -> Float[Array, "8 cells"]:
    """The largest ratio of each quantity to its limit in each cell, from samples and parabolas through them."""
    v = jnp.sum(jnp.asarray(within, coefficients.dtype) * local(coefficients)[None, None], axis=2)
    usage = used(between, jnp.moveaxis(v, 1, 0).reshape(3, -1)).reshape(-1, CHECKED, v.shape[-1])
    before, at, after = usage[:, :-2], usage[:, 1:-1], usage[:, 2:]
    bend, change = 2 * at - before - after, after - before
    peak = (bend > 0) & (jnp.abs(change) <= 2 * bend)  # the vertex is between the three samples
    rise = jnp.where(peak, change**2 / (8 * jnp.where(peak, bend, 1.0)), 0.0)
    return jnp.maximum(jnp.max(usage, axis=1), jnp.max(at + rise, axis=1))


def _grouped(usage: Float[Array, "8 cells"]) -> Float[Array, "5 cells"]:
    """The usage by constraint: the upper bounds on a are one constraint, for which speeds are squared."""
    upper = jnp.max(usage[: len(UPPER)], axis=0) ** 2
    return jnp.concatenate([upper[None], usage[len(UPPER) :]])


def _at_nodes(factors: Float[Array, "5 cells"]) -> Float[Array, "5 nodes"]:
    """The factors at the nodes; at a knot, the larger one of the two cells."""
    one = jnp.ones_like(factors[:, :1])
    before, after = jnp.concatenate([one, factors], axis=1), jnp.concatenate([factors, one], axis=1)
    return jnp.concatenate([jnp.maximum(before, after), factors], axis=1)


def _initial(p: Program) -> Float[Array, " cells+3"]:
    """The coefficients of a smooth curve that vanishes where the vehicle is at rest."""
    count = p.nodes.free.shape[0]
    x = jnp.clip(jnp.arange(count, dtype=p.weights.dtype) - 1, 0, count - DEGREE) / (count - DEGREE)
    starts, ends = p.nodes.free[0] < 1, p.nodes.free[-1] < 1
    return jnp.where(starts, x * (2 - x), 1.0) * jnp.where(ends, (1 - x) * (1 + x), 1.0)


def _largest_part(c: Constraints, v: Array) -> Scalar:
    """The factor by which a can be multiplied until it reaches a limit."""
    g = values(c, v) + 1
    return 1 / jnp.maximum(
        jnp.maximum(jnp.max(g[0]), jnp.max(g[1:-1]) ** 0.5), jnp.maximum(jnp.max(g[-1]) ** (1 / 3), 1e-12)
    )


@eqx.filter_jit
def _sensitivity(program: Program, r: _Round) -> Scalar:
    """Zero, with the derivatives of the minimum duration: those of the Lagrangian at the optimum (envelope theorem)."""
    v = stop_gradient(at_nodes(program.nodes, r.coefficients))
    limits = values(tightened(program.constraints, _at_nodes(r.used)), v)
    lagrangian = duration(program, v) + jnp.sum(r.multipliers * limits)
    return lagrangian - stop_gradient(lagrangian)
