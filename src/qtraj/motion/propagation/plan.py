"""Adaptive steps of a propagation: steps with large errors are split until the total error is within the tolerance.

If rate and times are concrete, the mesh grows as needed. If they are traced, it has a fixed number of slots.
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
"""The default maximum outside a trace, where unused steps cost nothing."""

MAX_ROUNDS = 64
"""Maximum number of refinements, enough to reach the spacing of float64 at a jump of the rate."""


def fixed(problem: Problem, steps: int) -> Mesh:
    """`steps` equal steps in every interval; ValueError for `steps` < 1."""
    if steps < 1:
        raise ValueError(f"steps must be at least 1 in each interval, but {steps!r} was given")
    return meshes.uniform(problem.intervals, steps, problem.intervals * steps, problem.times.dtype)


def adaptive(problem: Problem, max_steps: int | None) -> tuple[Mesh, Errors]:
    """A mesh that satisfies the tolerance, and its errors; if `max_steps` is too small, the finest mesh within it.

    **Raises:** ValueError if `max_steps` is less than the number of intervals.
    """
    if max_steps is not None and max_steps < problem.intervals:
        raise ValueError(
            f"max_steps={max_steps} is less than the number of intervals between the times, {problem.intervals}"
        )
    with at_once():
        mesh = _first_mesh(problem.intervals, _slots(problem.intervals), problem.times.dtype)
        first = step_errors(problem, mesh)
        if concrete(first.truncation) is not None and concrete(stop_gradient(problem.tolerance)) is not None:
            return _refine_growing(problem, mesh, first, MAX_STEPS if max_steps is None else max_steps)
    return _refine_traced(problem, traced_slots(problem) if max_steps is None else max_steps)


def traced_slots(problem: Problem) -> int:
    """The default `max_steps` inside a trace: 256 at order 16, 2048 at 6, 16384 at 4; at least four per interval."""
    return max(2 ** min(16, 6 + 32 // problem.method.order), 4 * problem.intervals)


def _refine_growing(problem: Problem, mesh: Mesh, errors: Errors, max_steps: int) -> tuple[Mesh, Errors]:
    tolerance, order = stop_gradient(problem.tolerance), problem.method.order
    for _ in range(MAX_ROUNDS):
        if not errors.truncation > tolerance:  # true also for NaN
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
    """The number of slots for `count` steps: 64 times a power of four, so that few sizes are compiled."""
    slots = 64
    while slots < count:
        slots *= 4
    return slots


def _power_of_two(count: int) -> int:
    return 1 << max(count - 1, 7).bit_length()
