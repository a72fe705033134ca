"""Derivatives of the solution of a tuning problem with respect to its data (implicit function theorem).

A solution z, with the multipliers λ and the times u of the active peaks, satisfies

    ∇f + Σ λ ∇g = 0,   g(z, u) = 0,   ∂g/∂u = 0,

where f is the cost, and g are the active constraints. These conditions are smooth functions of the data
θ (boundary states and limits) as long as the same peaks are active. So their derivatives with respect to (z, λ, u) and
θ give the derivatives of (z, λ, u). The searches themselves are never differentiated.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning import host_sensitivity
from qtraj.design.tuning.problem import broadcasting
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.subproblem import ACTIVE, AT_BOUND
from qtraj.design.tuning.task import Task, constraint_values
from qtraj.foundation.arrays import is_traced


@eqx.filter_custom_jvp
def solutions(tasks: Task, results: SearchResult) -> Float[Array, "batch n"]:
    """Return the solutions of a batch of searches as differentiable functions of the tasks.

    For a few problems outside jit, the derivatives of first order come from jets on the host.
    """
    return jnp.asarray(results.z)


@solutions.def_jvp
def _differentiate_all(
    primals: tuple[Task, SearchResult], tangents: tuple[Task, SearchResult | None]
) -> tuple[Array, Array]:
    tasks, results = primals
    moving = jax.tree.map(lambda x, change: change is not None, tasks, tangents[0])
    if is_traced(primals) or not host_sensitivity.is_supported(tasks, moving):
        return _compiled(tasks, results, tangents[0])
    changes = [x.reshape(len(x), -1) for x in jax.tree.leaves(tangents[0])]
    known = np.isfinite(np.asarray(results.z)).all(axis=1, keepdims=True)
    derivatives = host_sensitivity.derivatives(tasks, results, moving)
    return jnp.asarray(results.z), _applied(derivatives, known, changes)


@jax.jit
def _applied(
    derivatives: Float[Array, "batch n p"], known: Bool[Array, "batch 1"], changes: list[Float[Array, "batch _"]]
) -> Float[Array, "batch n"]:
    """Return the changes of the variables for changes of the data, 0 where the solution is not known."""
    change = jnp.einsum("bnp,bp->bn", derivatives, jnp.concatenate(changes, axis=1))
    return jnp.where(known, change, 0.0)


@eqx.filter_jit
def _compiled(tasks: Task, results: SearchResult, changes: Task) -> tuple[Array, Array]:
    def z(tasks: Task) -> Array:
        return jax.vmap(lambda task, result: solution(task, result).z)(tasks, results)

    with broadcasting():
        return eqx.filter_jvp(z, (tasks,), (changes,))


class Solution(NamedTuple):
    """The solution of a problem: the variables, and the multipliers and times of the active peaks."""

    z: Float[Array, " n"]
    multipliers: Float[Array, " k"]
    times: Float[Array, " k"]


class _Kinds(NamedTuple):
    """Which peaks are active, which of them move in time, and which variables are at their lower or upper bounds."""

    active: Bool[Array, " k"]
    inner: Bool[Array, " k"]
    low: Bool[Array, " n"]
    high: Bool[Array, " n"]


@eqx.filter_custom_jvp
def solution(task: Task, result: SearchResult) -> Solution:
    """Return the solution of a search as a differentiable function of the task."""
    return Solution(result.z, _multipliers(task, result), result.time)


def _multipliers(task: Task, result: SearchResult) -> Float[Array, " k"]:
    """Return the multipliers of the active peaks that satisfy the conditions best (least squares).

    The multipliers of a search are those of its last subproblem. They are less accurate than its variables, and the
    second derivatives of the Lagrangian need accurate ones.
    """
    active = result.multiplier > ACTIVE
    free = (result.z > task.low + AT_BOUND) & (result.z < task.high - AT_BOUND)
    slope = jnp.where(free, jax.grad(task.problem.cost)(result.z), 0.0)
    slopes = jax.jacfwd(lambda z: _at(task, result, z, result.time))(result.z)
    slopes = jnp.where(active[:, None] & free[None], slopes, 0.0)
    found = jnp.linalg.lstsq(slopes.T, -slope)[0]
    return jnp.where(active, jnp.maximum(found, 2 * ACTIVE), result.multiplier)


@solution.def_jvp
def _differentiate(
    primals: tuple[Task, SearchResult], tangents: tuple[Task, SearchResult | None]
) -> tuple[Solution, Solution]:
    with broadcasting():
        return _solve(primals, tangents[0])


def _solve(primals: tuple[Task, SearchResult], tangents: Task) -> tuple[Solution, Solution]:
    task, result = primals
    at = solution(task, result)  # depends on the task, so that higher derivatives are correct, too
    arrays, rest = eqx.partition(task, eqx.is_inexact_array)
    changes = jax.tree.map(_or_zeros, arrays, tangents, is_leaf=lambda x: x is None)
    kinds = _kinds(task, result, jax.lax.stop_gradient(at))
    flat, unflatten = ravel_pytree(at)
    change = jax.jvp(lambda a: _conditions(eqx.combine(a, rest), result, at, kinds), (arrays,), (changes,))[1]
    matrix = jax.jacfwd(lambda x: _conditions(task, result, unflatten(x), kinds))(flat)
    return at, unflatten(jnp.linalg.solve(matrix, -change))


def _or_zeros(x: Array | None, change: Array | None) -> Array | None:
    return jnp.zeros_like(x) if change is None and x is not None else change


def _kinds(task: Task, result: SearchResult, at: Solution) -> _Kinds:
    active = at.multipliers > ACTIVE
    bend = _rate(lambda times: _rate(lambda times: _at(task, result, at.z, times), times), at.times)
    low = at.z <= task.low + AT_BOUND
    high = (at.z >= task.high - AT_BOUND) & ~low
    return _Kinds(active, active & (at.times > 0) & (at.times < 1) & (bend < 0), low, high)


def _rate(values: Callable[[Array], Array], times: Float[Array, " k"]) -> Float[Array, " k"]:
    """Return the derivative of each value with respect to its own time."""
    return jax.jvp(values, (times,), (jnp.ones_like(times),))[1]


def _at(task: Task, result: SearchResult, z: Array, times: Float[Array, " k"]) -> Float[Array, " k"]:
    """Return the constraint values of all active peaks."""
    count = len(task.limits)
    g = constraint_values(task, z, jnp.broadcast_to(times, (count, *times.shape)))
    return jnp.sum(jnp.where(jnp.arange(count)[:, None] == result.limit, g, 0.0), axis=0)


def _conditions(task: Task, result: SearchResult, at: Solution, kinds: _Kinds) -> Float[Array, " n+2k"]:
    """Return the left-hand sides of the conditions; those of unused elements keep these elements unchanged."""

    def lagrangian(z: Array, times: Array) -> Array:
        g = jnp.where(kinds.active, _at(task, result, z, times), 0.0)
        return task.problem.cost(z) + jnp.sum(jnp.where(kinds.active, at.multipliers, 0.0) * g)

    slope, rate = jax.grad(lagrangian, (0, 1))(at.z, at.times)
    slope = jnp.where(kinds.low, at.z - task.low, jnp.where(kinds.high, at.z - task.high, slope))
    g = _at(task, result, at.z, at.times)
    constant = jax.lax.stop_gradient(at)
    return jnp.concatenate([
        slope,
        jnp.where(kinds.active, g, at.multipliers - constant.multipliers),
        jnp.where(kinds.inner, rate, at.times - constant.times),
    ])  # fmt: skip
