"""Check the arguments of a propagation, and compute its solution and error estimates on a mesh."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.foundation.arrays import as_float, constants, require_positive
from qtraj.foundation.namespace import needs_jax, on_host, xp
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.checks import at_once, common_dtype, initial_quaternion, output_times, require_axes
from qtraj.motion.propagation import mesh as meshes
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.increment import AbstractIncrement, propagated, require_method
from qtraj.motion.propagation.mesh import Errors, Mesh
from qtraj.motion.propagation.sampling import Sampler, vectorized

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
    require_method(method)
    if not callable(omega):
        raise ValueError(
            f"omega must be a function of time, but {type(omega).__name__} was given: for recorded rates call "
            "propagate_samples(times, rates, q0)"
        )
    with at_once():
        times, q0 = output_times(times), initial_quaternion(q0)
        dtype = common_dtype(times, q0)
        if tolerance is None:
            tolerance = TOLERANCE if dtype == jnp.float64 else TOLERANCE_FLOAT32
        tolerance = as_float(tolerance).astype(dtype)
        require_positive(tolerance, "the tolerance", "rad")
        method = GaussLegendre() if method is None else method
        return Problem(omega, q0.astype(dtype), times.astype(dtype), tolerance, method, axes)


class KnownProblem(NamedTuple):
    """A problem with known values: instants [s] and tolerance [rad] in NumPy, and `rate`, which samples ω in NumPy."""

    rate: Sampler
    times: Any
    tolerance: Any
    method: AbstractIncrement

    def sampled(self, start: Any, h: Any, nodes: Any) -> Any:
        """Return the rates (n, s, k) at the nodes of steps; None if the rates are traced."""
        at = meshes.instants(start, h, nodes)
        rates = self.rate(at.ravel())
        return None if rates is None else rates.reshape(*at.shape, -1)


def known_part(problem: Problem) -> KnownProblem | None:
    """Return the problem without the initial quaternion, in NumPy and without derivatives; None if it is traced."""
    omega, times, tolerance = constants((problem.omega, problem.times, problem.tolerance))
    if needs_jax(jax.tree.leaves((omega, times, tolerance))):
        return None
    return KnownProblem(Sampler(omega, times.dtype), on_host(times), on_host(tolerance), problem.method)


@eqx.filter_jit
def solve(problem: Problem, mesh: Mesh) -> Float[Array, "n 4"]:
    """Compute the quaternions at the output times with the steps of `mesh`, in JAX."""
    rates, _, h = _rates(problem, mesh, problem.method.nodes)
    qs = propagated(problem.method, problem.axes, problem.q0, rates, h)
    return at_outputs(problem.q0, qs, mesh, problem.intervals)


def at_outputs(q0: Quat, qs: Float[Array, "n 4"], mesh: Mesh, intervals: int) -> Float[Array, "m 4"]:
    """Return the quaternions at the output times from those after each step."""
    return xp.concatenate([q0[None], qs[meshes.last_steps(mesh, intervals)]])


@eqx.filter_jit
def mesh_errors(problem: Problem, mesh: Mesh) -> Errors:
    """Estimate the errors of the steps of `mesh`, in JAX; the estimates are not differentiated."""
    rates, start, h = _rates(problem, mesh, meshes.estimate_nodes(problem.method))
    return meshes.total_errors(meshes.step_errors(problem.method, rates, start, h), mesh.count)


def _rates(problem: Problem, mesh: Mesh, nodes: Any) -> tuple[Array, Array, Array]:
    """Return the rates (n, s, k) at the nodes of the steps, and the start and the length [s] of each step."""
    start, h = meshes.spans(mesh, problem.times)
    at = meshes.instants(start, h, nodes)
    rates = vectorized(problem.omega, at.ravel())
    return rates.reshape(*at.shape, -1), start, h
