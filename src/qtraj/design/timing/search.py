"""From few cells to many: the fastest timing of a path by interior-point searches, each begun where the last ended."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float
from scipy.interpolate import BSpline, make_interp_spline

from qtraj.design.timing.constraints import COUNT, Constraints, at_nodes, constraints, tightened, used, values
from qtraj.design.timing.interior_point import Program, State, duration, solve
from qtraj.design.timing.spline import DEGREE, Nodes, clamped, local, nodes, power_form, within
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph

COARSEST, FINER = 16, 8
"""The fewest cells with which a search begins, and how many times more the next has."""

COARSE, FINE, LAST = 1.0, 1e-2, 1e-8
"""Relative duality gaps: where the first search and the later ones begin, and where the last ends."""

ROUNDS, OVER, CHECKED = 2, 1.3, 16
"""Limits are tightened so often where they are passed between the nodes, by this part of the excess, as seen at so many
places in each cell."""

INSIDE, CLOSE = 0.9, 0.98
"""Part of the limits up to which the initial values of the first and of later searches go."""


class Problem(NamedTuple):
    """A path, its limits by name (infinite where there is none), and the largest squared path speed at its ends."""

    path: AbstractHodograph
    bounds: dict[str, Scalar]
    ends: Float[Array, " 2"]


class Found(NamedTuple):
    """The squared path speed in powers of the place in each cell, the derivatives of the time, and the last iterate."""

    powers: Float[Array, "cells 4"]
    sensitivity: Scalar
    state: State


def fastest(problem: Problem, cells: int, rest: tuple[bool, bool]) -> Found:
    """The fastest timing in `cells` cells; its duration has derivatives in the path and the limits."""
    fixed = stop_gradient(problem)
    sizes = [cells]
    while sizes[0] >= COARSEST * FINER:
        sizes.insert(0, sizes[0] // FINER)
    first = _shape(sizes[0] + DEGREE, rest, fixed.path.duration.dtype)
    gaps = COARSE
    for size in sizes:
        plain = jnp.ones((COUNT, size), first.dtype)
        state = _searched(fixed, nodes(size, rest), first, plain, gaps, LAST if size == cells else FINE)
        gaps = FINE
        first = jnp.asarray(prolongation(size, size * FINER)) @ state.coefficients if size < cells else first
    factors = jnp.ones((COUNT, cells), first.dtype)
    for _ in range(ROUNDS):
        factors = factors * _excess(fixed, within(cells, CHECKED), state)
        state = _searched(fixed, nodes(cells, rest), state.coefficients, factors, gaps, LAST)
    powers = jnp.sum(jnp.asarray(power_form(cells), first.dtype) * local(state.coefficients)[:, None], axis=-1)
    return Found(powers, _sensitivity(problem, nodes(cells, rest), state, factors), state)


@functools.lru_cache(maxsize=8)
def prolongation(cells: int, more: int) -> Float[np.ndarray, "more+3 cells+3"]:
    """The matrix from the coefficients of a spline to those of the same spline in more cells."""
    knots = clamped(more)
    places = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3
    coarse = BSpline(clamped(cells), np.eye(cells + DEGREE), DEGREE)(places * cells / more)
    return make_interp_spline(places, coarse, DEGREE, t=knots).c


@eqx.filter_jit
def _searched(
    problem: Problem,
    tables: Nodes,
    first: Float[Array, "cells+3"],
    factors: Float[Array, "7 cells"],
    begin: Scalar | float,
    end: Scalar | float,
) -> State:
    """The search from coefficients that are made smaller where they leave the limits; the coarsest also larger."""
    program = _program(problem, tables)
    program = program._replace(constraints=tightened(program.constraints, factors))
    part = _largest_part(program.constraints, at_nodes(program.basis, first))
    part = jnp.where(begin == COARSE, INSIDE * part, jnp.minimum(CLOSE * part, 1.0))
    return solve(program, first * part, (jnp.asarray(begin), jnp.asarray(end)))


@eqx.filter_jit
def _excess(problem: Problem, tables: Nodes, state: State) -> Float[Array, "7 cells"]:
    """By what each limit must be tightened in each cell to hold between the nodes too."""
    program = _program(problem, tables)
    most = jnp.max(used(program.constraints, at_nodes(program.basis, state.coefficients)), axis=-1)
    return jnp.where(most > 1, 1 + OVER * (most - 1), 1.0)


def _program(problem: Problem, tables: Nodes) -> Program:
    path, dtype = problem.path, problem.path.duration.dtype
    cells = tables.place.shape[0]
    place, weight, basis, free = (jnp.asarray(x, dtype) for x in tables)
    per_cell = path.duration / cells
    at = (jnp.arange(cells, dtype=dtype)[:, None] + place) * per_cell
    imposed = constraints(path, at, per_cell, problem.bounds)
    ends = 1 / problem.ends
    linear = imposed.linear.at[0, 0, 0, 0].max(ends[0]).at[0, -1, -1, 0].max(ends[1])
    return Program(basis, weight * per_cell, imposed._replace(linear=linear), free)


def _shape(count: int, rest: tuple[bool, bool], dtype: Any) -> Array:
    """A smooth curve that vanishes where the vehicle is at rest."""
    x = (jnp.clip(jnp.arange(count, dtype=dtype) - 1, 0, count - 3)) / (count - 3)
    return (x * (2 - x) if rest[0] else 1.0) * ((1 - x) * (1 + x) if rest[1] else 1.0) * jnp.ones_like(x)


def _largest_part(c: Constraints, v: Array) -> Scalar:
    """The factor by which a may grow until it reaches a limit."""
    parts = used(c, v)
    linear, jerk = jnp.max(parts[:6]), jnp.max(parts[6]) ** (2 / 3)
    return 1 / jnp.maximum(jnp.maximum(linear, jerk), 1e-12)


@eqx.filter_jit
def _sensitivity(problem: Problem, tables: Nodes, state: State, factors: Array) -> Scalar:
    """Zero, with the derivatives of the least time: those of the Lagrangian at the optimum (envelope theorem)."""
    program = _program(problem, tables)
    v = stop_gradient(at_nodes(program.basis, state.coefficients))
    limits = values(tightened(program.constraints, stop_gradient(factors)), v)
    lagrangian = duration(program.weights, v) + jnp.sum(stop_gradient(state.multipliers) * limits)
    return lagrangian - stop_gradient(lagrangian)
