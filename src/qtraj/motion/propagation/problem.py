"""Check the arguments of a propagation, and compute its solution and error estimates on a mesh."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.foundation.arrays import as_float, require_positive
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.checks import at_once, common_dtype, initial_quaternion, output_times, require_axes
from qtraj.motion.propagation import mesh as meshes
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.increment import AbstractIncrement, accumulate, from_body, increments, to_body
from qtraj.motion.propagation.mesh import Errors, Mesh, SampledRates

TOLERANCE = 1e-12
"""Default tolerance [rad] of the total error in float64."""

TOLERANCE_FLOAT32 = 1e-5
"""Default tolerance [rad] of the total error in float32, about a hundred times the round-off."""

Rate = TypeAliasType("Rate", Callable[..., Any])


class Problem(eqx.Module):
    """The checked arguments of `propagate`."""

    omega: Rate
    q0: Quat
    times: Float[Array, " n"]
    tolerance: Scalar
    method: AbstractIncrement
    axes: str = eqx.field(static=True)

    @property
    def intervals(self) -> int:
        """The number of intervals between the output times."""
        return self.times.shape[0] - 1


def checked(
    omega: Rate,
    q0: ArrayInput,
    times: ArrayInput,
    method: AbstractIncrement | None,
    axes: str,
    tolerance: ArrayInput | None,
) -> Problem:
    """Return the problem with arrays of one dtype, and with defaults for arguments that are None.

    **Raises:** ValueError for invalid arguments.
    """
    require_axes(axes)
    with at_once():
        times, q0 = output_times(times), initial_quaternion(q0)
        dtype = common_dtype(times, q0)
        if tolerance is None:
            tolerance = TOLERANCE if dtype == jnp.float64 else TOLERANCE_FLOAT32
        tolerance = as_float(tolerance).astype(dtype)
        require_positive(tolerance, "the tolerance", "rad")
        method = GaussLegendre() if method is None else method
        return Problem(omega, q0.astype(dtype), times.astype(dtype), tolerance, method, axes)


def solve(problem: Problem, mesh: Mesh) -> Float[Array, "n 4"]:
    """Compute the quaternions at the output times with the steps of `mesh`."""
    sampled = _sample(problem.omega, problem.times, mesh, problem.method.nodes)
    qs = _multiply(problem.method, problem.axes, problem.q0, sampled)
    return _pick(problem.intervals, mesh, problem.q0, qs)


def step_errors(problem: Problem, mesh: Mesh) -> Errors:
    """Estimate the errors of the steps of `mesh`; the estimates are not differentiated."""
    sampled = _sample(problem.omega, problem.times, mesh, meshes.estimate_nodes(problem.method))
    return _estimate(problem.method, mesh.count, sampled)


# The functions below are compiled separately: only `_sample` depends on ω, and it compiles fast.


@eqx.filter_jit
def _sample(omega: Rate, times: Array, mesh: Mesh, nodes: Float[ArrayLike, " s"]) -> SampledRates:
    start, h = meshes.spans(mesh, times)
    end = start + h
    before = jnp.maximum(
        start, end - 4 * float(jnp.finfo(h.dtype).eps) * jnp.abs(end)
    )  # at the end itself, ω may already have the value after a jump
    at = jnp.minimum(start[:, None] + jnp.outer(h, jnp.asarray(nodes, h.dtype)), before[:, None])
    rates = jax.vmap(jax.vmap(lambda t: jnp.asarray(omega(t))))(at)
    if rates.shape[2:] not in ((3,), (4,)):
        raise ValueError(
            f"omega(t) must have shape (3,), or (4,) with the scalar part first, but has shape {rates.shape[2:]}"
        )
    return SampledRates(rates.astype(h.dtype), start, h)


@eqx.filter_jit
def _multiply(method: AbstractIncrement, axes: str, q0: Quat, sampled: SampledRates) -> Float[Array, "n 4"]:
    q0, rates = to_body(q0, sampled.rates, axes)
    return from_body(accumulate(q0, *increments(method, rates, sampled.h)), axes)


@eqx.filter_jit
def _pick(intervals: int, mesh: Mesh, q0: Quat, qs: Array) -> Float[Array, "n 4"]:
    return jnp.concatenate([q0[None], qs[meshes.last_steps(mesh, intervals)]])


@eqx.filter_jit
def _estimate(method: AbstractIncrement, count: Array, sampled: SampledRates) -> Errors:
    return meshes.estimate(method, sampled, count)
