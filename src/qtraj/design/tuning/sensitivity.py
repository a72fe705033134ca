"""Derivatives of the solution of a tuning problem with respect to its data (implicit function theorem).

A solution z, with the multipliers λ and the times u of the active peaks, satisfies

    w ∇f + Σ λ ∇g = 0,   g(z, u) = 0,   ∂g/∂u = 0,

where w is the weight of the cost f, and g are the active constraints. These conditions are smooth functions of the data
θ (boundary states and limits) as long as the same peaks are active. A dot denotes the change due to a change of θ. The
third condition gives the changes of the times, du = −(g_uz dz + ġ_u)/g_uu. The others are then a small linear system:

    (w ∇²f + Σ λ (∇²g − g_zu g_uz/g_uu)) dz + Σ ∇g dλ = −(w ∇ḟ + Σ λ (∇ġ − g_zu ġ_u/g_uu)),   ∇g·dz = −ġ.

Its coefficients come from the same formulas as the steps of "sqp". The searches themselves are never differentiated.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning.constraints import GROUP, Setting, of_one_path
from qtraj.design.tuning.curves import CurveDerivatives
from qtraj.design.tuning.expansions import Expansion, expansions
from qtraj.design.tuning.model import differentiated
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.subproblem import ACTIVE, AT_BOUND
from qtraj.design.tuning.task import Task, limit_slots

PerPeak = Float[Array, "limits k"]


class Solution(NamedTuple):
    """The solution of a problem: the variables, and the multipliers and times of the peaks of each limit."""

    z: Variables
    multipliers: PerPeak
    times: PerPeak


class _Terms(NamedTuple):
    """The terms of the conditions that change with the data: w ∇f, and g, ∇g and ∂g/∂u at each peak."""

    slope: Float[Array, " n"]
    g: PerPeak
    gradient: Float[Array, "limits n k"]
    rate: PerPeak


@eqx.filter_custom_jvp
def solution(task: Task, result: SearchResult, names: tuple[str, ...]) -> Solution:
    """Return the solution of a search as a differentiable function of the task; `names` are the limits' names."""
    return Solution(result.z, result.multipliers[: len(names)], result.times[: len(names)])


@solution.def_jvp
def _differentiate(
    primals: tuple[Task, SearchResult, tuple[str, ...]], tangents: tuple[Task, SearchResult, None]
) -> tuple[Solution, Solution]:
    task, result, names = primals
    at = solution(task, result, names)  # depends on the task, so that higher derivatives are correct, too
    arrays, rest = eqx.partition(task, eqx.is_inexact_array)
    changes = jax.tree.map(_or_zeros, arrays, tangents[0], is_leaf=lambda x: x is None)
    terms, change, (curvature, g) = jax.jvp(
        lambda arrays: _terms(eqx.combine(arrays, rest), at, names), (arrays,), (changes,), has_aux=True
    )
    active = at.multipliers > ACTIVE
    inner = active & (at.times > 0) & (at.times < 1) & (g.second_rate < 0)
    inverse = jnp.where(inner, 1 / jnp.where(inner, g.second_rate, 1.0), 0.0)  # of g_uu

    def weighted(x: Float[Array, "limits *n k"]) -> Float[Array, "*n"]:
        extended = jnp.expand_dims(active, tuple(range(1, x.ndim - 1)))
        return jnp.einsum("lk,l...k->...", at.multipliers, jnp.where(extended, x, 0.0))

    shift = inverse[:, None] * g.mixed
    hessian = curvature + weighted(g.curvature - shift[:, :, None] * g.mixed[:, None])
    force = change.slope + weighted(change.gradient - shift * change.rate[:, None])
    gradients = _rows(jnp.where(active[:, None], terms.gradient, 0.0))
    matrix = jnp.block([[hessian, gradients.T], [gradients, jnp.diag(jnp.where(active, 0.0, 1.0).ravel())]])
    known = -jnp.concatenate([force, jnp.where(active, change.g, 0.0).ravel()])
    dz, multipliers = _solve_with_bounds(task, changes, at.z, matrix, known)
    times = -jnp.where(inner, jnp.einsum("lnk,n->lk", shift, dz) + inverse * change.rate, 0.0)
    return at, Solution(dz, multipliers.reshape(active.shape), times)


def _or_zeros(x: Array | None, change: Array | None) -> Array | None:
    return jnp.zeros_like(x) if change is None and x is not None else change


def _terms(task: Task, at: Solution, names: tuple[str, ...]) -> tuple[_Terms, tuple[Array, Expansion]]:
    """Return the terms of the conditions at constant z and times, and w ∇²f with the expansions of the constraints."""
    slope, curvature, here, derivatives = differentiated(task.problem, at.z)
    g = _expansions(here, derivatives, task.limits[: len(names)], at.times, names)
    return _Terms(task.weight * slope, g.value, g.slope, g.rate), (task.weight * curvature, g)


def _expansions(
    here: Setting,
    derivatives: CurveDerivatives,
    limits: Float[Array, " limits"],
    times: PerPeak,
    names: tuple[str, ...],
) -> Expansion:
    """Return the expansions of all constraints; the formulas of each group of limits are compiled once."""
    index = limit_slots(names).index[: len(names)]
    groups, parts, order = GROUP[index], [], []
    for group in np.unique(groups):
        own = np.flatnonzero(groups == group)
        one = partial(of_one_path(partial(expansions, group=int(group))), here, derivatives)
        parts.append(jax.vmap(one)(index[own], limits[own], times[own]))
        order += own.tolist()
    return jax.tree.map(lambda *x: jnp.concatenate(x)[np.argsort(order)], *parts)


def _rows(gradients: Float[Array, "limits n k"]) -> Float[Array, "constraints n"]:
    """Return the gradients of all constraints as the rows of a matrix."""
    return jnp.swapaxes(gradients, 1, 2).reshape(-1, gradients.shape[1])


def _solve_with_bounds(
    task: Task, changes: Task, z: Variables, matrix: Float[Array, "m m"], known: Float[Array, " m"]
) -> tuple[Array, Array]:
    """Return the changes of the variables and of the multipliers; a variable at a bound changes with the bound."""
    low = z <= task.low + AT_BOUND
    high = (z >= task.high - AT_BOUND) & (task.high > task.low)
    fixed: Bool[Array, " n"] = low | high
    n = z.size
    unit = jnp.eye(n, matrix.shape[0], dtype=z.dtype)
    matrix = matrix.at[:n].set(jnp.where(fixed[:, None], unit, matrix[:n]))
    known = known.at[:n].set(jnp.where(fixed, jnp.where(low, changes.low, changes.high), known[:n]))
    dz, multipliers = jnp.split(jnp.linalg.solve(matrix, known), [n])
    return dz, multipliers
