"""Choosing the steps of a propagation: split those that err most, until the whole is within the tolerance.

Where the rate and the times are known the mesh grows as it must; inside a trace it has a fixed number of slots.
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
"""Outside a trace, where only the steps that are needed cost anything."""

ROUNDS = 64
"""Splittings in succession: enough to reach the spacing of float64 at a jump of the rate."""


def fixed(problem: Problem, steps: int) -> Mesh:
    """`steps` equal steps in every interval (ValueError for none)."""
    if steps < 1:
        raise ValueError(f"at least one step per interval is needed, but steps={steps!r} was given")
    return meshes.uniform(problem.intervals, steps, problem.intervals * steps, problem.times.dtype)


def adaptive(problem: Problem, max_steps: int | None) -> tuple[Mesh, Errors]:
    """Steps for the tolerance and their errors; where `max_steps` are too few, the best mesh found.

    **Raises:** ValueError for fewer `max_steps` than intervals.
    """
    if max_steps is not None and max_steps < problem.intervals:
        raise ValueError(f"max_steps={max_steps} is fewer than the {problem.intervals} intervals between the times")
    with at_once():
        mesh = _first_mesh(problem.intervals, _slots(problem.intervals), problem.times.dtype)
        first = step_errors(problem, mesh)
        if concrete(first.truncation) is not None and concrete(stop_gradient(problem.tolerance)) is not None:
            return _grown(problem, mesh, first, MAX_STEPS if max_steps is None else max_steps)
    return _within(problem, traced_slots(problem) if max_steps is None else max_steps)


def traced_slots(problem: Problem) -> int:
    """The default `max_steps` inside a trace: 256 at order 16, 2048 at 6, 16384 at 4; at least four per interval."""
    return max(2 ** min(16, 6 + 32 // problem.method.order), 4 * problem.intervals)


def _grown(problem: Problem, mesh: Mesh, found: Errors, max_steps: int) -> tuple[Mesh, Errors]:
    tolerance, order = stop_gradient(problem.tolerance), problem.method.order
    for _ in range(ROUNDS):
        if not found.truncation > tolerance:  # also where it is NaN
            break
        finer, wanted = _refine(mesh, found, tolerance, order)
        if wanted > max_steps:
            break
        if wanted > mesh.start.shape[0]:
            slots = _slots(int(wanted))
            finer, _ = _refine(_resized(mesh, slots), _padded(found, slots), tolerance, order)
        mesh, found = finer, step_errors(problem, finer)
    return _resized(mesh, _power_of_two(int(mesh.count))), found


def _within(problem: Problem, slots: int) -> tuple[Mesh, Errors]:
    tolerance, order = stop_gradient(problem.tolerance), problem.method.order

    def unfinished(state):
        _, found, fits, rounds = state
        return (found.truncation > tolerance) & fits & (rounds < ROUNDS)

    def split(state):
        mesh, found, _, rounds = state
        finer, wanted = meshes.refine(mesh, found, tolerance, order)
        return finer, step_errors(problem, finer), wanted <= slots, rounds + 1

    mesh = meshes.first_mesh(problem.intervals, slots, problem.times.dtype)
    start = mesh, step_errors(problem, mesh), jnp.asarray(True), jnp.asarray(0)
    mesh, found, _, _ = jax.lax.while_loop(unfinished, split, start)
    return mesh, found


_first_mesh = eqx.filter_jit(meshes.first_mesh)
_refine = eqx.filter_jit(meshes.refine)
_resized = eqx.filter_jit(meshes.resized)
_padded = eqx.filter_jit(meshes.padded)


def _slots(count: int) -> int:
    """Room for `count` steps, by powers of four from 64: few sizes, so that few programs are compiled."""
    slots = 64
    while slots < count:
        slots *= 4
    return slots


def _power_of_two(count: int) -> int:
    return 1 << max(count - 1, 7).bit_length()
