"""The fastest timing of a path in given cells: interior-point searches, with limits tightened between the nodes."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.design.timing.constraints import COUNT, UPPER, Constraints, Parts, parts, tightened, used, values
from qtraj.design.timing.grid import Grid, Shape, derivatives
from qtraj.design.timing.interior_point import Program, State, duration, solve
from qtraj.design.timing.spline import DEGREE, Nodes, at_nodes, local, nodes, power_form, within
from qtraj.foundation.types import Scalar

GAPS = ((1.0, 1e-2), (1e-2, 1e-5), (1e-4, 1e-8))
"""Relative duality gaps at which searches begin and end. Before each but the first, the limits are tightened."""

FINEST = 128
"""Cells from which on the last gap grows with their squared number: rounding in the jerk keeps it from 1e-8."""

OVER, CHECKED = 1.3, 9
"""Limits are tightened by this part of the excess between the nodes, as seen at so many places of each cell."""

INSIDE, CLOSE = 0.9, 0.98
"""Part of the limits up to which the initial values of the first and of later searches go."""


class Problem(NamedTuple):
    """A path, its limits by name (infinite where there is none), and the largest squared path speed at its ends."""

    shape: Shape
    bounds: dict[str, Scalar]
    ends: Float[Array, " 2"]


class Tables(NamedTuple):
    """What the cells alone determine: the grid, its nodes, and the spline at places within each cell."""

    grid: Grid
    nodes: Nodes
    within: Float[np.ndarray, "places 3 4 cells"]
    powers: Float[np.ndarray, "4 4 cells"]


class Found(NamedTuple):
    """The fastest timing of a path in its cells.

    `powers` (cells, 4): the squared path speed in powers of the place in each cell. `usage` (limits, cells): the
    largest part of each limit that is used, in the order of `NAMES`. `sensitivity` is zero and has the derivatives of
    the least time. `steps` counts those of all searches, and `error` is the last one's.
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


@eqx.filter_jit
def fastest(problem: Problem, t: Tables) -> Found:
    """The fastest timing; `sensitivity` has derivatives in the path and the limits."""
    imposed, places = _imposed(problem, t)
    exact = _program(problem, t, imposed)
    program, between = stop_gradient((exact, places))

    def attempt(carry: Any, gaps: Array) -> tuple[Any, Array]:
        coefficients, _, factors, taken, _ = carry
        own = program._replace(constraints=tightened(program.constraints, _at_nodes(factors)))
        part = _largest_part(own.constraints, at_nodes(own.nodes, coefficients))
        part = jnp.where(gaps[0] >= 1, INSIDE * part, jnp.minimum(CLOSE * part, 1.0))
        state = solve(own, coefficients * part, (gaps[0], gaps[1]))
        usage = _between_nodes(between, t, state.coefficients)
        excess = _grouped(jnp.max(usage, axis=1))
        more = jnp.where((excess > 1) & (gaps[1] > gaps[2]), 1 + OVER * (excess - 1), 1.0)
        carry = (state.coefficients, state.multipliers, factors * more, taken + state.steps, state.error)
        return carry, usage

    first = _initial(program)
    cells, dtype = t.grid.cells, first.dtype
    start = (
        first,
        jnp.zeros((COUNT, 2 * cells + 1), dtype),
        jnp.ones((COUNT, cells), dtype),
        jnp.zeros((), jnp.int32),
        jnp.full((), jnp.inf, dtype),
    )
    last = last_gap(cells)
    gaps = jnp.asarray([(a, max(b, last), last) for a, b in GAPS], dtype)
    (coefficients, multipliers, factors, steps, error), usages = jax.lax.scan(attempt, start, gaps)
    powers = jnp.sum(jnp.asarray(t.powers, dtype) * local(coefficients)[None], axis=1).T
    usage = usages[-1]
    factors = _at_nodes(factors)
    v = at_nodes(program.nodes, coefficients)
    return Found(stop_gradient(powers), jnp.max(usage, axis=1), _sensitivity(exact, v, multipliers, factors), steps, error)


def _program(problem: Problem, t: Tables, imposed: Parts) -> Program:
    dtype, cells = problem.shape.per_cell.dtype, t.grid.cells
    own: Nodes = jax.tree.map(lambda x: jnp.asarray(x, dtype), t.nodes)
    c = imposed.constraints()
    upper = c.upper.at[0].max(1 / problem.ends[0]).at[cells].max(1 / problem.ends[1])
    return Program(
        own,
        own.weight * problem.shape.per_cell,
        Constraints(upper, c.forms, jnp.where(own.standing > 0, 0.0, c.jerk)),
    )


def _imposed(problem: Problem, t: Tables) -> tuple[Parts, Parts]:
    """The limits at the nodes, and at places within the cells."""
    cells, grid = t.grid.cells, t.grid
    cell = np.concatenate([np.arange(cells), [cells - 1], np.arange(cells), np.tile(np.arange(cells), CHECKED)])
    nodes, dtype = 2 * cells + 1, problem.shape.per_cell.dtype
    knots, at, own = jnp.asarray(grid.knots), jnp.asarray(t.nodes.place), cell[:nodes]
    places = jnp.asarray(np.repeat(np.linspace(0.0, 1.0, CHECKED), cells), dtype)
    place = jnp.concatenate([(at - knots[own]) / (knots[own + 1] - knots[own]), places])
    r = derivatives(problem.shape, grid, cell, place)
    found = parts(r, problem.shape.per_cell, problem.bounds)
    return Parts(*(x[..., :nodes] for x in found)), Parts(*(x[..., nodes:] for x in found))


def _between_nodes(between: Parts, t: Tables, coefficients: Array) -> Float[Array, "8 places cells"]:
    """The used part of each limit at places within the cells."""
    v = jnp.sum(jnp.asarray(t.within, coefficients.dtype) * local(coefficients)[None, None], axis=2)
    return used(between, jnp.moveaxis(v, 1, 0).reshape(3, -1)).reshape(-1, CHECKED, t.grid.cells)


def _grouped(usage: Float[Array, "8 cells"]) -> Float[Array, "5 cells"]:
    """By constraints: the upper bounds, in a instead of √a for speeds, are one."""
    upper = jnp.max(usage[: len(UPPER)], axis=0) ** 2
    return jnp.concatenate([upper[None], usage[len(UPPER) :]])


def _at_nodes(factors: Float[Array, "5 cells"]) -> Float[Array, "5 nodes"]:
    """Those of the cells; at a knot the larger of its two."""
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
    """The factor by which a may grow until it reaches a limit."""
    g = values(c, v) + 1
    return 1 / jnp.maximum(
        jnp.maximum(jnp.max(g[0]), jnp.max(g[1:-1]) ** 0.5), jnp.maximum(jnp.max(g[-1]) ** (1 / 3), 1e-12)
    )


def _sensitivity(program: Program, v: Array, multipliers: Array, factors: Array) -> Scalar:
    """Zero, with the derivatives of the least time: those of the Lagrangian at the optimum (envelope theorem)."""
    fixed = stop_gradient((v, multipliers, factors))
    limits = values(tightened(program.constraints, fixed[2]), fixed[0])
    lagrangian = duration(program, fixed[0]) + jnp.sum(fixed[1] * limits)
    return lagrangian - stop_gradient(lagrangian)
