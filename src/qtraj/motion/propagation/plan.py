"""Choose the steps of a propagation, by splitting steps with large errors until the total error is small enough.

If the values of the rate, the times and the tolerance are known, NumPy chooses the steps, and their number grows as
needed. Otherwise JAX chooses them at run time, and the mesh has a fixed number of slots.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.foundation.namespace import stop_gradient
from qtraj.motion.propagation import mesh as meshes
from qtraj.motion.propagation.increment import AbstractIncrement
from qtraj.motion.propagation.mesh import Errors, Mesh, StepErrors
from qtraj.motion.propagation.problem import KnownProblem, Problem, mesh_errors

MAX_STEPS = 2**18
"""Default of `max_steps` outside a trace, where unused slots cost no time."""

MAX_ROUNDS = 64
"""Maximum number of refinements, enough to halve the steps at a jump of the rate down to float64 round-off."""


def require_steps(steps: int) -> None:
    """Raise a ValueError unless there is at least one step in each interval, and a whole number of them."""
    if not isinstance(steps, int | np.integer) or isinstance(steps, bool) or steps < 1:
        raise ValueError(f"steps must be a whole number, at least 1 in each interval, but {steps!r} was given")


def require_max_steps(max_steps: int | None, intervals: int) -> None:
    """Raise a ValueError if there are more intervals than steps, or if `max_steps` is not a whole number."""
    if max_steps is not None and (not isinstance(max_steps, int | np.integer) or isinstance(max_steps, bool)):
        raise ValueError(f"max_steps must be a whole number, but {max_steps!r} was given")
    if max_steps is not None and max_steps < intervals:
        raise ValueError(
            f"max_steps must be at least the number of intervals between the times, {intervals}, "
            f"but {max_steps} was given"
        )


def known(problem: KnownProblem, steps: int | None, max_steps: int | None) -> tuple[Mesh, Any, Errors] | None:
    """Return a mesh that satisfies the tolerance, the rates at the nodes of its steps, and its errors.

    `steps`: a fixed number of equal steps in each interval, or None. If more than `max_steps` steps are needed, the
    mesh of the last refinement within `max_steps` is returned. The result is None if the rates are traced.
    """
    intervals = len(problem.times) - 1
    mesh = meshes.first_mesh(intervals) if steps is None else meshes.uniform(intervals, steps)
    sampled = _sampled(problem, mesh, np.arange(len(mesh.start)))
    if sampled is None:
        return None
    rates, errors = sampled
    total = meshes.total_errors(errors, mesh.count)
    if steps is None:
        limit = MAX_STEPS if max_steps is None else max_steps
        mesh, rates, total = _refined(problem, mesh, rates, errors, limit)
    return mesh, rates[:, : len(problem.method.nodes)], total


def rates_at_nodes(problem: KnownProblem, mesh: Mesh) -> Any:
    """Return the rates at the nodes of the steps of a mesh; None if the rates are traced."""
    return problem.sampled(*meshes.spans(mesh, problem.times), problem.method.nodes)


def _refined(
    problem: KnownProblem, mesh: Mesh, rates: Any, errors: StepErrors, max_steps: int
) -> tuple[Mesh, Any, Errors]:
    for _ in range(MAX_ROUNDS):
        total = meshes.total_errors(errors, mesh.count)
        if not total.truncation > problem.tolerance:  # also true if `truncation` is NaN
            break
        parts = meshes.pieces(mesh, total, problem.tolerance, problem.method.order)
        if (needed := int(parts.sum())) > max_steps:
            break
        finer, parent = meshes.split_steps(mesh, parts, needed)
        new = np.flatnonzero(parts[parent] > 1)
        sampled: Any = _sampled(problem, finer, new)
        mesh, rates, errors = finer, rates[parent], jax.tree.map(lambda x: x[parent], errors)  # noqa: B023
        rates[new] = sampled[0]
        errors.step[new], errors.noise[new] = sampled[1].step, sampled[1].noise
    return mesh, rates, meshes.total_errors(errors, mesh.count)


def _sampled(problem: KnownProblem, mesh: Mesh, rows: Any) -> tuple[Any, StepErrors] | None:
    """Return the rates at the nodes of the steps `rows` of a mesh, and their errors; None if the rates are traced."""
    start, h = (x[rows] for x in meshes.spans(mesh, problem.times))
    rates = problem.sampled(start, h, meshes.estimate_nodes(problem.method))
    if rates is None:
        return None
    return rates, meshes.step_errors(problem.method, rates, start, h)


def traced_slots(method: AbstractIncrement, intervals: int) -> int:
    """Return the default of `max_steps` inside a trace.

    The default is 256 for methods of order 16, 2048 for order 6 and 16384 for order 4, but at least four steps for each
    interval.
    """
    return max(2 ** min(16, 6 + 32 // method.order), 4 * intervals)


def traced(problem: Problem, max_steps: int | None) -> tuple[Mesh, Errors]:
    """Return a mesh that satisfies the tolerance, and its errors, inside a trace (see `known`)."""
    intervals = problem.intervals
    slots = traced_slots(problem.method, intervals) if max_steps is None else max_steps
    tolerance, order = stop_gradient(problem.tolerance), problem.method.order

    def unfinished(state: Any) -> Any:
        _, errors, fits, rounds = state
        return (errors.truncation > tolerance) & fits & (rounds < MAX_ROUNDS)

    def split(state: Any) -> Any:
        mesh, errors, _, rounds = state
        finer, needed = meshes.refine(mesh, errors, tolerance, order)
        return finer, mesh_errors(problem, finer), needed <= slots, rounds + 1

    mesh = meshes.on_device(meshes.first_mesh(intervals, slots), problem.times.dtype)
    start = mesh, mesh_errors(problem, mesh), jnp.asarray(True), jnp.asarray(0)
    mesh, errors, _, _ = jax.lax.while_loop(unfinished, split, start)
    return mesh, errors
