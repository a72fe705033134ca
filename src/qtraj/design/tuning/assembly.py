"""Assemble the outcome of a tuning from the results of searches."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import SAMPLED
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.outcome import CONVERGED, INFEASIBLE, NOT_CONVERGED, Tuned
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.sensitivity import solution
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task, limit_names
from qtraj.foundation.arrays import is_traced, part
from qtraj.foundation.outcome import ResultCode
from qtraj.path.boundary import BoundaryState
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.vehicle_data import with_batch


def make_outcome(
    tasks: Task,
    limits: Limits,
    corridor: Array | None,
    result: SearchResult,
    start: BoundaryState,
    end: BoundaryState,
    batch: tuple[int, ...],
    placement: Placement | None,
    faults: Any,
) -> Tuned:
    """Return the outcome of a batch of tasks (possibly padded); `faults` is the result of `fault_codes`."""
    z = result.z
    if is_traced(tasks):
        z = _solutions(tasks, jax.lax.stop_gradient(result), limit_names(limits, corridor))
    unbatched = lambda x: part(x, slice(0, batch[0]) if batch else 0)  # noqa: E731
    path, objective, first, last = jax.tree.map(unbatched, _paths(tasks.problem, z, start, end))
    reference = None
    if corridor is not None:
        reference = jax.tree.map(unbatched, _paths(tasks.problem, jnp.zeros_like(z), start, end)[0])
    if placement is None:
        path = eqx.tree_at(lambda path: path.placement, path, None)
        reference = None if reference is None else eqx.tree_at(lambda path: path.placement, reference, None)
    ill_posed = faults != ResultCode.successful
    if is_traced(ill_posed) or np.any(ill_posed):
        axis = path.placement
        path, objective, first, last = _with_nan((path, objective, first, last), ill_posed)
        # The certificate requires that path and reference have equal placements, and NaN is not equal to NaN.
        path = eqx.tree_at(lambda path: path.placement, path, axis, is_leaf=lambda x: x is None)
    certificate = certify(path, limits, corridor=corridor, reference=reference)
    code = _code(unbatched(result.stationary), unbatched(result.violation), certificate.codes <= SAMPLED)
    xp: Any = jnp if is_traced(code, faults) else np
    code = xp.where(ill_posed, faults, code).astype(np.int32)
    vehicle = with_batch(limits.vehicle, batch[0]) if batch else limits.vehicle
    return Tuned(path, first, last, objective, certificate, code, unbatched(result.steps), vehicle=vehicle)


@eqx.filter_jit
def _solutions(tasks: Task, results: SearchResult, names: tuple[str, ...]) -> Float[Array, "batch n"]:
    """Return the solutions of a batch as differentiable functions of the tasks."""
    return jax.vmap(lambda task, result: solution(task, result, names).z)(tasks, results)


def _with_nan(data: Any, ill_posed: Any) -> Any:
    """Replace the ill-posed elements of `data` by NaN."""
    return jax.tree.map(
        lambda x: jnp.where(jnp.expand_dims(ill_posed, range(ill_posed.ndim, x.ndim)), jnp.nan, x), data
    )


def _code(stationary: Any, violation: Any, findings_met: Any) -> Any:
    """Return the result code, from the search result and the findings on the path."""
    xp: Any = jnp if is_traced(stationary, violation, findings_met) else np
    all_met = xp.all(xp.asarray(findings_met), axis=-1)
    feasible = xp.asarray(violation) <= FEASIBLE
    code = xp.where(xp.asarray(stationary) & all_met & feasible, CONVERGED, NOT_CONVERGED)
    return xp.where(~feasible & ~all_met, INFEASIBLE, code).astype(np.int32)


@eqx.filter_jit
def _paths(
    problems: Problem, z: Float[Array, "batch n"], start: BoundaryState, end: BoundaryState
) -> tuple[SpiralHelix, Array, BoundaryState, BoundaryState]:
    """Return the paths of the solutions, the values of the objective, and the boundary states at the start and end."""

    def one(problem: Problem, z: Array, start: BoundaryState, end: BoundaryState) -> tuple[Any, ...]:
        path = problem.path(z)
        velocities = jax.vmap(path.velocity)(jnp.stack([jnp.zeros_like(path.duration), path.duration]))
        first, last = BoundaryState(start.position, velocities[0]), BoundaryState(end.position, velocities[1])
        return path, problem.objective.value(problem, z), first, last

    return jax.vmap(one)(problems, z, start, end)
