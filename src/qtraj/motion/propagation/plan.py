"""Choose the steps of a propagation, by splitting steps with large errors until the total error is small enough.

If rates, times and tolerance are concrete, the mesh grows as needed. Otherwise, the mesh has a fixed number of slots.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.lax import stop_gradient

from qtraj.foundation.arrays import concrete
from qtraj.motion.checks import at_once
from qtraj.motion.propagation import mesh as meshes
from qtraj.motion.propagation.mesh import Errors, Mesh
from qtraj.motion.propagation.problem import Problem, step_errors

MAX_STEPS = 2**18
"""Default of `max_steps` outside a trace, where unused slots cost no time."""

MAX_ROUNDS = 64
"""Maximum number of refinements, enough to halve the steps at a jump of the rate down to float64 round-off."""


def fixed(problem: Problem, steps: int) -> Mesh:
    """Return a mesh with `steps` equal steps in every interval; raise a ValueError for `steps` < 1."""
    if steps < 1:
        raise ValueError(f"steps must be at least 1 in each interval, but {steps!r} was given")
    return meshes.uniform(problem.intervals, steps, problem.intervals * steps, problem.times.dtype)


def adaptive(problem: Problem, max_steps: int | None) -> tuple[Mesh, Errors]:
    """Return a mesh that satisfies the tolerance, and its errors.

    If more than `max_steps` steps are needed, the mesh of the last refinement within `max_steps` is returned.

    **Raises:** ValueError if `max_steps` is less than the number of intervals.
    """
    if max_steps is not None and max_steps < problem.intervals:
        raise ValueError(
            f"max_steps must be at least the number of intervals between the times, {problem.intervals}, "
            f"but {max_steps} was given"
        )
    with at_once():
        mesh = _first_mesh(problem.intervals, _slots(problem.intervals), problem.times.dtype)
        first = step_errors(problem, mesh)
        if concrete(first.truncation) is not None and concrete(stop_gradient(problem.tolerance)) is not None:
            return _refine_growing(problem, mesh, first, MAX_STEPS if max_steps is None else max_steps)
    return _refine_traced(problem, traced_slots(problem) if max_steps is None else max_steps)


def traced_slots(problem: Problem) -> int:
    """Return the default of `max_steps` inside a trace.

    The default is 256 for methods of order 16, 2048 for order 6 and 16384 for order 4, but at least four steps for each
    interval.
    """
    return max(2 ** min(16, 6 + 32 // problem.method.order), 4 * problem.intervals)


def _refine_growing(problem: Problem, mesh: Mesh, errors: Errors, max_steps: int) -> tuple[Mesh, Errors]:
    tolerance, order = stop_gradient(problem.tolerance), problem.method.order
    for _ in range(MAX_ROUNDS):
        if not errors.truncation > tolerance:  # also true if `truncation` is NaN
            break
        finer, needed = _refine(mesh, errors, tolerance, order)
        if needed > max_steps:
            break
        if needed > mesh.start.shape[0]:
            slots = _slots(int(needed))
            finer, _ = _refine(_resized(mesh, slots), _padded(errors, slots), tolerance, order)
        mesh, errors = finer, step_errors(problem, finer)
    return _resized(mesh, _power_of_two(int(mesh.count))), errors


def _refine_traced(problem: Problem, slots: int) -> tuple[Mesh, Errors]:
    tolerance, order = stop_gradient(problem.tolerance), problem.method.order

    def unfinished(state):
        _, errors, fits, rounds = state
        return (errors.truncation > tolerance) & fits & (rounds < MAX_ROUNDS)

    def split(state):
        mesh, errors, _, rounds = state
        finer, needed = meshes.refine(mesh, errors, tolerance, order)
        return finer, step_errors(problem, finer), needed <= slots, rounds + 1

    mesh = meshes.first_mesh(problem.intervals, slots, problem.times.dtype)
    start = mesh, step_errors(problem, mesh), jnp.asarray(True), jnp.asarray(0)
    mesh, errors, _, _ = jax.lax.while_loop(unfinished, split, start)
    return mesh, errors


_first_mesh = eqx.filter_jit(meshes.first_mesh)
_refine = eqx.filter_jit(meshes.refine)
_resized = eqx.filter_jit(meshes.resized)
_padded = eqx.filter_jit(meshes.padded)


def _slots(count: int) -> int:
    """Return the number of slots for `count` steps, 64 times a power of four, so that few sizes are compiled."""
    slots = 64
    while slots < count:
        slots *= 4
    return slots


def _power_of_two(count: int) -> int:
    return 1 << max(count - 1, 7).bit_length()
