"""Assemble the outcome of a tuning from the results of searches."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import SAMPLED
from qtraj.design.proof.certify import certify
from qtraj.design.tuning import ends
from qtraj.design.tuning.model import objective_values
from qtraj.design.tuning.outcome import CONVERGED, INFEASIBLE, NOT_CONVERGED, Tuned
from qtraj.design.tuning.problem import broadcasting
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.sensitivity import solutions
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task, as_jax, one
from qtraj.foundation.arrays import is_traced
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
    """Return the outcome of a batch of tasks; `faults` is the result of `fault_codes`."""
    if not tasks.problem.objective.is_formula:
        tasks = eqx.tree_at(lambda task: task.problem.scale, tasks, jax.lax.stop_gradient(result.scale))
    if is_traced(tasks, result):
        parts = _traced_paths(tasks, solutions(tasks, jax.lax.stop_gradient(result)), start, end)
        parts = parts if batch else one(parts)
    else:
        with np.errstate(all="ignore"):
            parts = _paths(tasks, result.z.T, start, end)
        parts = as_jax(parts if batch else one(parts))  # in this order, because an index compiles for a JAX array
    path, objective, first, last, reference = parts
    if placement is None:
        path, reference = (eqx.tree_at(lambda path: path.placement, x, None) for x in (path, reference))
    ill_posed = faults != ResultCode.successful
    if is_traced(ill_posed) or np.any(ill_posed):
        axis = path.placement
        path, objective, first, last = _with_nan((path, objective, first, last), ill_posed)
        # The certificate requires that path and reference have equal placements, and NaN is not equal to NaN.
        path = eqx.tree_at(lambda path: path.placement, path, axis, is_leaf=lambda x: x is None)
    certificate = certify(path, limits, corridor=corridor, reference=None if corridor is None else reference)
    numbers = result.stationary, result.violation, result.steps, result.starts
    stationary, violation, steps, tried = (x if batch else x[0] for x in numbers)
    code = _code(stationary, violation, _concrete_or_traced(certificate.codes) <= SAMPLED)
    xp: Any = jnp if is_traced(code, faults) else np
    code = xp.where(ill_posed, faults, code).astype(np.int32)
    vehicle = with_batch(limits.vehicle, batch[0]) if batch else limits.vehicle
    return Tuned(path, first, last, objective, certificate, code, steps, vehicle=vehicle, starts_tried=tried)


def _concrete_or_traced(x: Array) -> Any:
    return x if is_traced(x) else np.asarray(x)


def _paths(
    tasks: Task, z: Any, start: BoundaryState, end: BoundaryState
) -> tuple[SpiralHelix, Any, BoundaryState, BoundaryState, SpiralHelix]:
    """Return the paths, the values of the objective, the boundary states at both ends, and the initial paths."""
    problem = tasks.problem
    velocities = problem.world_velocities(z)
    states = (ends.at(state, velocity) for state, velocity in zip((start, end), velocities, strict=True))
    return problem.path(z), objective_values(problem, z), *states, problem.path(problem.zero)  # type: ignore[return-value]


@eqx.filter_jit
def _traced_paths(tasks: Task, z: Array, start: BoundaryState, end: BoundaryState) -> Any:
    """Return the results of `_paths` for the variables (batch, n) as differentiable functions."""
    with broadcasting():
        return _paths(tasks, z.T, start, end)


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
