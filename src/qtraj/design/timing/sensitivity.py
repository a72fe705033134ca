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

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Float

from qtraj.design.on_host import on_host
from qtraj.design.timing.constraint_values import Gradients, changes, gradients, values, weighted
from qtraj.design.timing.program import Program, duration, factored, solved
from qtraj.design.timing.seam import repeated
from qtraj.design.timing.spline import Nodes, gathered
from qtraj.foundation.types import Scalar


class Optimum(NamedTuple):
    """The coefficients of the last search, and the slacks and multipliers of its constraints."""

    coefficients: Float[Any, " cells+3"]
    slacks: Float[Any, "count 2 cells+1"]
    multipliers: Float[Any, "count 2 cells+1"]


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

    def slope(program: Program) -> Any:
        return _slope(program, v, at.multipliers)

    slopes = gradients(program.constraints, v)
    at_nodes = jax.jvp(slope, (program,), (change,))[1] + weighted(slopes, ratio * rise)
    matrix = _second_derivatives(program, at, v, slopes, ratio)
    fixed = stop_gradient(matrix)

    def product(dc: Any) -> Any:
        at_nodes = jnp.einsum("ij...,j...->i...", matrix, program.at_nodes(dc * free))
        return gathered(program.nodes, at_nodes) * free

    right = -gathered(program.nodes, at_nodes) * free
    nodes = program.nodes
    dc = jax.lax.custom_linear_solve(product, right, lambda _, x: _solved(nodes, fixed, x), symmetric=True)
    dc = repeated(dc, nodes.seam)
    ds = -(rise + changes(slopes, program.at_nodes(dc)))
    return Optimum(dc, ds, -ratio * ds)


def _solved(nodes: Nodes, matrix: Float[Any, "orders orders 2 cells+1"], right: Float[Any, " cells+3"]) -> Any:
    """Solve the linear system with the second derivatives `matrix` at the nodes, on the host."""

    def solve(nodes: Nodes, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        own = Nodes(*(x[0] for x in nodes))
        return solved(factored(own, np.moveaxis(matrix, 0, 2)[np.tril_indices(matrix.shape[1])]), right) * own.free

    return on_host(solve, jax.ShapeDtypeStruct(right.shape, right.dtype), nodes, matrix, right)


def _lagrangian(p: Program, v: Any, multipliers: Any) -> Scalar:
    return duration(p, v) + jnp.sum(multipliers * values(p.constraints, v))


def _slope(p: Program, v: Any, multipliers: Any) -> Any:
    """Return the gradient of the Lagrangian at the nodes with respect to a = u̇², a' and a''."""
    return jax.grad(lambda v: _lagrangian(p, v, multipliers))(v)


def _second_derivatives(
    p: Program, at: Optimum, v: Any, slopes: Gradients, ratio: Any
) -> Float[Any, "orders orders 2 cells+1"]:
    """Return the second derivatives of the Lagrangian at the nodes, plus Σ (λ/s) ∇g ∇gᵀ."""
    units = [jnp.zeros_like(v).at[j].set(1.0) for j in range(v.shape[0])]
    columns = [jax.jvp(lambda v: _slope(p, v, at.multipliers), (v,), (unit,))[1] for unit in units]
    return jnp.stack(columns) + jnp.einsum("ci...,cj...->ij...", ratio[:, None] * slopes, slopes)
