"""From where searches ended to the outcome of a tuning: its paths, what is known of their limits, and its code."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import SAMPLED
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.outcome import CONVERGED, INFEASIBLE, NOT_CONVERGED, Tuned
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import Found
from qtraj.design.tuning.sensitivity import solution
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task, names_of
from qtraj.foundation.arrays import part
from qtraj.foundation.outcome import ResultCode
from qtraj.path.boundary import BoundaryState
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix


def outcome_of(
    tasks: Task,
    limits: Limits,
    corridor: Array | None,
    found: Found,
    start: BoundaryState,
    end: BoundaryState,
    batch: tuple[int, ...],
    placement: Placement | None,
    faults: Any,
) -> Tuned:
    """The outcome, from a batch that may be filled up; `faults` are the codes of what is ill-posed."""
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tasks))
    if traced:
        names, at = names_of(limits, corridor), jax.lax.stop_gradient(found)
        z = jax.vmap(lambda task, at: solution(task, at, names))(tasks, at)
    else:
        z = found.z
    # A callable objective may hold arrays, which are constants of the problem: it is not traced.
    reached = _reached if tasks.problem.objective.is_smooth else _paths
    own = lambda x: part(x, slice(0, batch[0]) if batch else 0)  # noqa: E731
    path, objective, first, last = jax.tree.map(own, reached(tasks.problem, z, start, end))
    reference = None
    if corridor is not None:
        reference = jax.tree.map(own, reached(tasks.problem, jnp.zeros_like(z), start, end)[0])
    if placement is None:
        path = eqx.tree_at(lambda path: path.placement, path, None)
        reference = None if reference is None else eqx.tree_at(lambda path: path.placement, reference, None)
    bad = faults != ResultCode.successful
    if traced or np.any(bad):
        axis = path.placement
        path, objective, first, last = _without((path, objective, first, last), bad)
        # The axis must stay that of the given path.
        path = eqx.tree_at(lambda path: path.placement, path, axis, is_leaf=lambda x: x is None)
    certificate = certify(path, limits, corridor=corridor, reference=reference)
    code = _code(own(found.settled), own(found.violation), certificate.codes <= SAMPLED)
    xp: Any = jnp if traced else np
    code = xp.where(bad, faults, code).astype(np.int32)
    return Tuned(path, first, last, objective, certificate, code, own(found.steps))


def _without(data: Any, bad: Any) -> Any:
    """`data` with NaN in the elements that are bad."""
    return jax.tree.map(lambda x: jnp.where(jnp.expand_dims(bad, range(bad.ndim, x.ndim)), jnp.nan, x), data)


def _code(settled: Any, violation: Any, met: Any) -> Any:
    """How a tuning ended, whose path has findings that are met or not."""
    xp: Any = jnp if any(isinstance(x, Tracer) for x in (settled, violation, met)) else np
    every = xp.all(xp.asarray(met), axis=-1)
    feasible = xp.asarray(violation) <= FEASIBLE
    code = xp.where(xp.asarray(settled) & every & feasible, CONVERGED, NOT_CONVERGED)
    return xp.where(~feasible & ~every, INFEASIBLE, code).astype(np.int32)


def _paths(
    problems: Problem, z: Float[Array, "batch n"], start: BoundaryState, end: BoundaryState
) -> tuple[SpiralHelix, Array, BoundaryState, BoundaryState]:
    """The paths of the solutions, the objectives there, and their boundary states."""

    def one(problem: Problem, z: Array, start: BoundaryState, end: BoundaryState) -> tuple[Any, ...]:
        path = problem.path(z)
        first = BoundaryState(start.position, path.velocity(0.0))
        last = BoundaryState(end.position, path.velocity(path.duration))
        return path, problem.objective.value(problem, z), first, last

    return jax.vmap(one)(problems, z, start, end)


_reached = eqx.filter_jit(_paths)
