"""Derivatives of the fastest timing with respect to the path and the limits (implicit function theorem).

The coefficients c of the last search, the slacks s and the multipliers λ of its constraints g(c) + s = 0 satisfy

    ∇f + Σ λ ∇g = 0,   s λ = μ,

where f is the duration and μ the barrier parameter of the last step. For a change of the data, marked by a dot, the
coefficients change by dc with

    (∇²(f + Σ λ g) + Σ (λ/s) ∇g ∇gᵀ) dc = −(∇ḟ + Σ λ ∇ġ + Σ (λ/s) ġ ∇g).

The matrix is a band matrix, like the matrix of a step, but with all second derivatives of the constraints, not only
with those that are convex. The tightening of the limits is constant. Only first derivatives are correct, because the
matrix, the slacks and the multipliers are constants, too.
"""

import jax
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.design.timing import banded
from qtraj.design.timing.banded import total
from qtraj.design.timing.constraints import gradients, values
from qtraj.design.timing.interior_point import Program, State, duration, factored, solved
from qtraj.design.timing.spline import gathered

Coefficients = Float[Array, " cells+3"]


@jax.custom_jvp
def coefficients(program: Program, at: State) -> Coefficients:
    """Return the coefficients of the optimum `at` as a differentiable function of the program."""
    return at.coefficients


@coefficients.defjvp
def _differentiate(
    primals: tuple[Program, State], tangents: tuple[Program, State]
) -> tuple[Coefficients, Coefficients]:
    (program, at), (change, _) = primals, tangents
    return coefficients(program, at), _change(program, change, at)


@jax.jit
def _change(program: Program, change: Program, at: State) -> Coefficients:
    """Return the change of the coefficients due to a change of the program."""
    fixed = stop_gradient(program)
    v, ratio = fixed.at_nodes(at.coefficients), at.multipliers / at.slacks
    given = values(fixed.constraints, v)

    def residual(program: Program) -> Coefficients:
        multipliers = at.multipliers + ratio * (values(program.constraints, v) - given)
        return gathered(fixed.nodes, [*_slope(program, v, multipliers)]) * fixed.nodes.free

    matrix = _second_derivatives(fixed, at, v, ratio)
    band = factored(banded, fixed, matrix)

    def product(dc: Coefficients) -> Coefficients:
        dv = fixed.at_nodes(dc * fixed.nodes.free)
        rows = [total(matrix[max(i, j)][min(i, j)] * x for j, x in enumerate(dv)) for i in range(dv.shape[0])]
        return gathered(fixed.nodes, rows) * fixed.nodes.free

    right = jax.jvp(residual, (program,), (change,))[1]
    return -jax.lax.custom_linear_solve(product, right, lambda _, x: solved(banded, band, x), symmetric=True)


def _slope(p: Program, v: Array, multipliers: Array) -> Array:
    """Return the gradient of the Lagrangian at the nodes with respect to a = u̇², a' and a''."""
    return jax.grad(lambda v: duration(p, v) + jnp.sum(multipliers * values(p.constraints, v)))(v)


def _second_derivatives(p: Program, at: State, v: Array, ratio: Array) -> list[list[Array]]:
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
