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

from qtraj.design.tuning import corridor
from qtraj.design.tuning.curves import cubics, given
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.search import Found
from qtraj.design.tuning.subproblem import ACTIVE, AT_BOUND
from qtraj.design.tuning.task import Task
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import CORRIDOR
from qtraj.path.values import squared


def constraint(problem: Problem, z: Variables, u: Scalar, name: str, limit: Scalar) -> Scalar:
    """g = ½((value/limit)² − 1) of one limit at the fraction `u` of the duration, by its definition."""
    if name == CORRIDOR.name:
        place = cubics(problem, problem.slopes(z)[0])
        return 0.5 * (corridor.value(place, given(problem), u[None])[0] / limit**2 - 1.0)
    path = problem.path(z)
    return 0.5 * (squared(path, u * path.duration, name) / limit**2 - 1.0)


class _Unknowns(NamedTuple):
    z: Variables
    multipliers: Float[Array, "slots k"]
    times: Float[Array, "slots k"]


class _Active(NamedTuple):
    """What holds at the solution: active rows, those of them that are inner peaks, variables at a bound."""

    rows: Bool[Array, "slots k"]
    inner: Bool[Array, "slots k"]
    low: Bool[Array, " n"]
    high: Bool[Array, " n"]


@eqx.filter_custom_jvp
def solution(task: Task, found: Found, names: tuple[str, ...]) -> Variables:
    """z* where a search ended, as a function of the task; `names` are those of the limits, slot after slot."""
    return found.z


@solution.def_jvp
def _differentiate(
    primals: tuple[Task, Found, tuple[str, ...]], tangents: tuple[Task, Found, None]
) -> tuple[Variables, Variables]:
    task, found, names = primals
    arrays, rest = eqx.partition(task, eqx.is_inexact_array)
    changes = jax.tree.map(_or_zeros, arrays, tangents[0], is_leaf=lambda x: x is None)
    active = _active(task, found)
    at = _Unknowns(found.z, found.multipliers, found.times)
    flat, unravel = jax.flatten_util.ravel_pytree(at)

    def residual(x: Float[Array, " m"], arrays: Task) -> Float[Array, " m"]:
        return jax.flatten_util.ravel_pytree(_conditions(eqx.combine(arrays, rest), unravel(x), at, active, names))[0]

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


def _conditions(task: Task, x: _Unknowns, at: _Unknowns, active: _Active, names: tuple[str, ...]) -> _Unknowns:
    """What vanishes at the solution; an unknown without a condition keeps its value."""
    empty = x.times.shape[0] - len(names)

    def rows(z: Variables, times: Float[Array, "slots k"]) -> Float[Array, "slots k"]:
        known = [
            jax.vmap(lambda u, name=name, k=k: constraint(task.problem, z, u, name, task.limits[k]))(times[k])
            for k, name in enumerate(names)
        ]
        return jnp.pad(jnp.stack(known), ((0, empty), (0, 0)))

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
