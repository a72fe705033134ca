"""Derivatives of the fastest timing with respect to the path and the limits (implicit function theorem).

The coefficients c of the last search, the slacks s and the multipliers λ of its constraints g(c) + s = 0 satisfy

    ∇f + Σ λ ∇g = 0,   s λ = μ,

where f is the duration and μ the barrier parameter of the last step. For a change of the data, marked by a dot, the
coefficients change by dc with

    (∇²(f + Σ λ g) + Σ (λ/s) ∇g ∇gᵀ) dc = −(∇ḟ + Σ λ ∇ġ + Σ (λ/s) ġ ∇g).

The matrix is a band matrix, like the matrix of a step, but with all second derivatives of the constraints, not only
with those that are convex. Then ds = −(ġ + ∇g·dc) and dλ = −(λ/s) ds. By the envelope theorem, the duration changes by
ḟ + Σ λ ġ. Each rule calls the differentiated function again, so second derivatives are correct, too. For an active
constraint, the terms of ds almost cancel, and each further derivative multiplies the error by λ/s. So third derivatives
of the duration are inaccurate. The tightening of the limits is constant.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.design.timing.constraints import Gradients, changes, gradients, values, weighted
from qtraj.design.timing.interior_point import Program, duration, factored, solved
from qtraj.design.timing.namespace import total
from qtraj.design.timing.on_host import on_host
from qtraj.design.timing.spline import Nodes, gathered, products
from qtraj.foundation.types import Scalar


class Optimum(NamedTuple):
    """The coefficients of the last search, and the slacks and multipliers of its constraints."""

    coefficients: Float[Array, " cells+3"]
    slacks: Float[Array, "count 2 cells+1"]
    multipliers: Float[Array, "count 2 cells+1"]


@jax.custom_jvp
def optimum(program: Program, at: Optimum) -> Optimum:
    """Return `at`, the optimum of the program, as a differentiable function of the program."""
    return at


@optimum.defjvp
def _optimum_jvp(primals: tuple[Program, Optimum], tangents: tuple[Program, Optimum]) -> tuple[Optimum, Optimum]:
    program, at = primals
    found = optimum(program, at)
    return found, _change(program, tangents[0], found)


@jax.custom_jvp
def duration_change(program: Program, at: Optimum) -> Scalar:
    """Return zero, with the derivatives of the minimum duration."""
    return jnp.zeros((), at.coefficients.dtype)


@duration_change.defjvp
def _duration_jvp(primals: tuple[Program, Optimum], tangents: tuple[Program, Optimum]) -> tuple[Scalar, Scalar]:
    program, at = primals
    found = optimum(program, at)
    v = program.at_nodes(found.coefficients)
    change = jax.jvp(lambda program: _lagrangian(program, v, found.multipliers), (program,), (tangents[0],))[1]
    return duration_change(program, at), change


@jax.jit
def _change(program: Program, change: Program, at: Optimum) -> Optimum:
    """Return the change of the optimum due to a change of the program."""
    v, ratio = program.at_nodes(at.coefficients), at.multipliers / at.slacks
    free = program.nodes.free
    rise = jax.jvp(lambda program: values(program.constraints, v), (program,), (change,))[1]

    def slope(program: Program) -> Array:
        return _slope(program, v, at.multipliers)

    slopes = gradients(program.constraints, v)
    at_nodes = jax.jvp(slope, (program,), (change,))[1] + _combined(slopes, ratio * rise, v)
    matrix = _second_derivatives(program, at, v, ratio)
    fixed = stop_gradient(jnp.stack([x for row in matrix for x in row]))

    def product(dc: Array) -> Array:
        dv = program.at_nodes(dc * free)
        rows = [total(matrix[max(i, j)][min(i, j)] * x for j, x in enumerate(dv)) for i in range(dv.shape[0])]
        return gathered(program.nodes, rows) * free

    right = -gathered(program.nodes, [*at_nodes]) * free
    nodes = program.nodes
    dc = jax.lax.custom_linear_solve(product, right, lambda _, x: _solved(nodes, fixed, x), symmetric=True)
    ds = -(rise + changes(slopes, program.at_nodes(dc)))
    return Optimum(dc, ds, -ratio * ds)


def _solved(nodes: Nodes, lower: Float[Array, "entries 2 cells+1"], right: Float[Array, " cells+3"]) -> Array:
    """Solve the linear system with the lower triangle `lower` of second derivatives at the nodes, on the host."""
    orders = {3: 2, 6: 3}[lower.shape[0]]

    def solve(basis: np.ndarray, free: np.ndarray, lower: np.ndarray, right: np.ndarray) -> np.ndarray:
        table = products(basis[:orders, :, 0])
        return solved(factored(free[0, 0], table, [list(lower)]), right[:, 0])

    shape = jax.ShapeDtypeStruct(right.shape, right.dtype)
    return on_host(solve, shape, nodes.basis, nodes.free[None], lower, right[None])


def _lagrangian(p: Program, v: Array, multipliers: Array) -> Scalar:
    return duration(p, v) + jnp.sum(multipliers * values(p.constraints, v))


def _slope(p: Program, v: Array, multipliers: Array) -> Array:
    """Return the gradient of the Lagrangian at the nodes with respect to a = u̇², a' and a''."""
    return jax.grad(lambda v: _lagrangian(p, v, multipliers))(v)


def _combined(slopes: Gradients, weights: Array, v: Array) -> Array:
    """Return the weighted sum of the gradients, with one component for each component of `v`."""
    parts = weighted(slopes, weights)
    return jnp.stack([*parts, *[jnp.zeros_like(parts[0])] * (v.shape[0] - len(parts))])


def _second_derivatives(p: Program, at: Optimum, v: Array, ratio: Array) -> list[list[Array]]:
    """Return the lower triangle of the second derivatives of the Lagrangian at the nodes, plus Σ (λ/s) ∇g ∇gᵀ."""
    orders = range(v.shape[0])
    units = [jnp.zeros_like(v).at[j].set(1.0) for j in orders]
    columns = [jax.jvp(lambda v: _slope(p, v, at.multipliers), (v,), (unit,))[1] for unit in units]
    lower = [[columns[j][i] for j in range(i + 1)] for i in orders]
    for own, weight in zip(gradients(p.constraints, v), ratio, strict=True):
        for i, x in enumerate(own):
            for j, y in enumerate(own[: i + 1]):
                lower[i][j] = lower[i][j] + weight * x * y
    return lower
