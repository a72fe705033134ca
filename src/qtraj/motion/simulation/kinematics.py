"""Integrate the motion of a body from its angular acceleration (paper C, section 1), without normalisation of λ.

Let λ be the quaternion, ω the rate and ε the acceleration. The equations in body axes (1.2) are ω̇_x = ε_x, 2λ̇ = λ∘ω_x;
in inertial axes (1.4), ω̇_ξ = ε_ξ, 2λ̇ = ω_ξ∘λ. λ, ω and ε have four components, so the state is in R⁸. The norm
satisfies |λ(t)|² = |λ(t0)|² exp(∫ω0 dt) (the sign of ω0 in the paper is an erratum). So |λ| is a state variable, and a
value other than 1 is not an error.
"""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Callable
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra.quaternion import derivative
from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.checks import require_axes
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.interval import MAX_STEPS, Method
from qtraj.motion.simulation.solution import Solution
from qtraj.motion.simulation.task import Setup, checked, setup

Acceleration = TypeAliasType("Acceleration", Callable[[Scalar, Quat, Quat], Quat])


def integrate(
    acceleration: Acceleration,
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    axes: str = "body",
    solver: Any = None,
    rtol: ArrayInput = 1e-10,
    atol: ArrayInput = 1e-12,
    *,
    jumps: ArrayInput | None = None,
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> Solution:
    """Integrate λ(t) and ω(t) from the angular acceleration ε = `acceleration`(t, λ, ω) (4,) [rad/s²].

    `quaternion` (4,), non-zero and not necessarily normalised, and `rate` [rad/s], (3,) or (4,) with the scalar part
    first: the state at times[0]. `times` (n,) [s]: the output instants. `axes`: "body" or "inertial", the axes of the
    rate, the acceleration and the solution's rate. `solver`: a diffrax solver, Dopri8 for None. `rtol` is relative to
    each component. `atol` is relative to |λ(0)| for λ, and relative to the larger of |ω(0)| and one radian per time
    span for ω. `jumps` (m,) [s]: instants at which ε jumps. With `jumps`, the integration is faster, and derivatives
    with respect to `jumps` are exact. `adjoint`: a diffrax adjoint. The default, None, supports both forward- and
    reverse-mode differentiation; for reverse mode in large batches, `diffrax.RecursiveCheckpointAdjoint()` may be
    faster. `max_steps`: the maximum number of steps between two instants.

    If the integration fails, `code` and `result` of the solution give the reason for each element of a batch, and
    values at instants that were not reached are NaN. If `throw` is true, an error is raised instead.

    For batches, `qtraj.in_blocks` takes fewer steps than `jax.vmap`, and does not compile again for other sizes.

    **Raises:** ValueError for times that do not increase strictly, or that are too far from zero to be resolved in
    their dtype; for λ = 0, values that are not finite, arrays (also ε) of the wrong shape, or unknown `axes`.
    RuntimeError if `throw` is true and an instant was not reached.
    """
    require_axes(axes)
    method = Method(solver, adjoint, max_steps)
    solution = _integrate(acceleration, setup(checked(quaternion, rate, times, jumps, rtol, atol, method)), axes)
    return solution.check() if throw else solution


@eqx.filter_jit
def _integrate(acceleration: Acceleration, setup: Setup, axes: str) -> Solution:
    task, scale = setup.task, setup.scale

    def field(t: Scalar, state: Float[Array, 8], memory: None) -> Float[Array, 8]:
        quaternion, rate = scale.unpack(state)
        epsilon = as_float(acceleration(t, quaternion, rate)).astype(state.dtype)
        if epsilon.shape != (4,):
            raise ValueError(
                "the acceleration must have shape (4,), with the virtual scalar part first (0 keeps ω0 constant, and "
                f"|λ| too if ω0 = 0), but has shape {epsilon.shape}"
            )
        return scale.pack(derivative(quaternion, rate, axes), epsilon)

    states, _, code = ode.march(field, ode.keep, setup.start, None, setup.grid, task.tolerances, task.method)
    return Solution(task.times, *scale.unpack(states[setup.outputs]), code, axes=axes)
