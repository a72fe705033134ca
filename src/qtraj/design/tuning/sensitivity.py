"""Derivatives of the solution of a tuning problem with respect to its data (implicit function theorem).

A solution z*, with the multipliers λ and the times u of the active peaks, satisfies

    w ∇f + Σ λ ∇g = 0,   g(z, u) = 0,   ∂g/∂u = 0,

where w is the weight of the cost f, and g are the active constraints. These conditions are smooth functions of the data
θ (boundary states and limits) as long as the same peaks are active. The derivatives of the conditions form a small
linear system for dz*/dθ. The searches themselves are never differentiated.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning import corridor
from qtraj.design.tuning.curves import cubics, reference_cubics
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.subproblem import ACTIVE, AT_BOUND
from qtraj.design.tuning.task import Task
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import CORRIDOR
from qtraj.path.values import squared


def constraint(problem: Problem, z: Variables, u: Scalar, name: str, limit: Scalar) -> Scalar:
    """Return the constraint g = ½((value/limit)² − 1) of one limit at the fraction `u` of the duration."""
    if name == CORRIDOR.name:
        place = cubics(problem, problem.slopes(z)[0])
        return 0.5 * (corridor.value(place, reference_cubics(problem), u[None])[0] / limit**2 - 1.0)
    path = problem.path(z)
    return 0.5 * (squared(path, u * path.duration, name, problem.road) / limit**2 - 1.0)


class _Unknowns(NamedTuple):
    z: Variables
    multipliers: Float[Array, "slots k"]
    times: Float[Array, "slots k"]


class _Active(NamedTuple):
    """The active set at the solution.

    The fields mark the active constraints, the active constraints at interior maxima, and the variables at a bound.
    """

    constraints: Bool[Array, "slots k"]
    inner: Bool[Array, "slots k"]
    low: Bool[Array, " n"]
    high: Bool[Array, " n"]


@eqx.filter_custom_jvp
def solution(task: Task, result: SearchResult, names: tuple[str, ...]) -> Variables:
    """Return the solution z* of a search as a differentiable function of the task; `names` are the limits' names."""
    return result.z


@solution.def_jvp
def _differentiate(
    primals: tuple[Task, SearchResult, tuple[str, ...]], tangents: tuple[Task, SearchResult, None]
) -> tuple[Variables, Variables]:
    task, result, names = primals
    arrays, rest = eqx.partition(task, eqx.is_inexact_array)
    changes = jax.tree.map(_or_zeros, arrays, tangents[0], is_leaf=lambda x: x is None)
    active = _active(task, result)
    at = _Unknowns(result.z, result.multipliers, result.times)
    flat, unravel = jax.flatten_util.ravel_pytree(at)

    def residual(x: Float[Array, " m"], arrays: Task) -> Float[Array, " m"]:
        return jax.flatten_util.ravel_pytree(_conditions(eqx.combine(arrays, rest), unravel(x), at, active, names))[0]

    matrix = jax.jacfwd(residual)(flat, arrays)
    _, change = jax.jvp(lambda arrays: residual(flat, arrays), (arrays,), (changes,))
    return result.z, unravel(-jnp.linalg.solve(matrix, change)).z


def _or_zeros(x: Array | None, change: Array | None) -> Array | None:
    return jnp.zeros_like(x) if change is None and x is not None else change


def _active(task: Task, result: SearchResult) -> _Active:
    active = result.multipliers > ACTIVE
    inner = active & (result.times > 0) & (result.times < 1)
    high = (result.z >= task.high - AT_BOUND) & (task.high > task.low)
    return _Active(active, inner, result.z <= task.low + AT_BOUND, high)


def _conditions(task: Task, x: _Unknowns, at: _Unknowns, active: _Active, names: tuple[str, ...]) -> _Unknowns:
    """Return the residual of the optimality conditions; unknowns without a condition are kept constant."""
    n_unused = x.times.shape[0] - len(names)

    def constraints(z: Variables, times: Float[Array, "slots k"]) -> Float[Array, "slots k"]:
        of_limits = [
            jax.vmap(lambda u, name=name, k=k: constraint(task.problem, z, u, name, task.limits[k]))(times[k])
            for k, name in enumerate(names)
        ]
        return jnp.pad(jnp.stack(of_limits), ((0, n_unused), (0, 0)))

    def lagrangian(z: Variables) -> Scalar:
        terms = jnp.where(active.constraints, x.multipliers * constraints(z, x.times), 0.0)
        return task.weight * task.problem.cost(z) + jnp.sum(terms)

    values, rates = jax.jvp(lambda u: constraints(x.z, u), (x.times,), (jnp.ones_like(x.times),))
    gradient = jax.grad(lagrangian)(x.z)
    return _Unknowns(
        jnp.where(active.low, x.z - task.low, jnp.where(active.high, x.z - task.high, gradient)),
        jnp.where(active.constraints, values, x.multipliers - at.multipliers),
        jnp.where(active.inner, rates, x.times - at.times),
    )
