"""How a tuned path answers to its data: derivatives of the solution, by the implicit function theorem.

At a solution z*, with multipliers λ of the active peaks and their times u,

    w ∇f + Σ λ ∇g = 0,   g(z, u) = 0,   ∂g/∂u = 0,

all smooth in the boundary data and the limits θ as long as the same peaks stay active. Differentiating gives a small
linear system for dz*/dθ: the searches themselves are never differentiated.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning.campaign import Found
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.rows import excess
from qtraj.design.tuning.subproblem import ACTIVE, AT_BOUND
from qtraj.design.tuning.task import Task


class _Unknowns(NamedTuple):
    z: Variables
    multipliers: Float[Array, "limits k"]
    times: Float[Array, "limits k"]


class _Active(NamedTuple):
    """What holds at the solution: active rows, those of them that are inner peaks, variables at a bound."""

    rows: Bool[Array, "limits k"]
    inner: Bool[Array, "limits k"]
    low: Bool[Array, " n"]
    high: Bool[Array, " n"]


@eqx.filter_custom_jvp
def solution(task: Task, found: Found) -> Variables:
    """z* where a search ended, as a function of the task."""
    return found.z


@solution.def_jvp
def _differentiate(primals: tuple[Task, Found], tangents: tuple[Task, Found]) -> tuple[Variables, Variables]:
    task, found = primals
    arrays, rest = eqx.partition(task, eqx.is_inexact_array)
    changes = jax.tree.map(_or_zeros, arrays, tangents[0], is_leaf=lambda x: x is None)
    active = _active(task, found)
    at = _Unknowns(found.z, found.multipliers, found.times)
    flat, unravel = jax.flatten_util.ravel_pytree(at)

    def residual(x: Float[Array, " m"], arrays: Task) -> Float[Array, " m"]:
        return jax.flatten_util.ravel_pytree(_conditions(eqx.combine(arrays, rest), unravel(x), at, active))[0]

    matrix = jax.jacfwd(residual)(flat, arrays)
    _, change = jax.jvp(lambda arrays: residual(flat, arrays), (arrays,), (changes,))
    return found.z, unravel(-jnp.linalg.solve(matrix, change)).z


def _or_zeros(x: Array | None, change: Array | None) -> Array | None:
    return jnp.zeros_like(x) if change is None and x is not None else change


def _active(task: Task, found: Found) -> _Active:
    rows = found.multipliers > ACTIVE
    inner = rows & (found.times > 0) & (found.times < 1)
    high = (found.z >= task.high - AT_BOUND) & (task.high > task.low)
    return _Active(rows, inner, found.z <= task.low + AT_BOUND, high)


def _conditions(task: Task, x: _Unknowns, at: _Unknowns, active: _Active) -> _Unknowns:
    """What vanishes at the solution; an unknown without a condition keeps its value."""

    def rows(z: Variables, times: Float[Array, "limits k"]) -> Float[Array, "limits k"]:
        given = task.limits.given().items()
        return jnp.stack(
            [
                jax.vmap(lambda u, name=name, limit=limit: excess(task.problem, z, u, name, limit))(times[k])
                for k, (name, limit) in enumerate(given)
            ]
        )

    values, rates = jax.jvp(lambda u: rows(x.z, u), (x.times,), (jnp.ones_like(x.times),))
    balance = jax.grad(
        lambda z: (
            task.weight * task.problem.cost(z) + jnp.sum(jnp.where(active.rows, x.multipliers * rows(z, x.times), 0.0))
        )
    )(x.z)
    held = jnp.where(active.low, x.z - task.low, jnp.where(active.high, x.z - task.high, balance))
    return _Unknowns(
        held,
        jnp.where(active.rows, values, x.multipliers - at.multipliers),
        jnp.where(active.inner, rates, x.times - at.times),
    )
