"""The motion of a body from its angular acceleration (paper C, section 1), in R⁸ and without normalisation.

Body form (1.2): ω̇_x = ε_x, 2λ̇ = λ∘ω_x. Inertial form (1.4): ω̇_ξ = ε_ξ, 2λ̇ = ω_ξ∘λ. All four components of ε are
given; |λ(t)|² = |λ(t0)|² exp∫ω0 (the paper's sign of ω0 is an erratum), so |λ| is a legitimate state and not an error.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.quaternion import derivative
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, real_vector, require_finite
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.ode import MAX_STEPS, Grid, Method, Tolerances
from qtraj.motion.simulation.solution import Solution

Acceleration = Callable[[Scalar, Quat, Quat], Quat]

RESOLUTION = 1000
"""The least number of round-off units of the first instant between two instants."""


class Scale(eqx.Module):
    """Units in which both halves of the state are of order one; constants to differentiation.

    `quaternion`: |λ(0)|. `rate` [rad/s]: one radian per span of time, or |ω(0)| where that is faster.
    """

    quaternion: Scalar
    rate: Scalar

    def __init__(self, quaternion: Quat, rate: Quat, times: Float[Array, " n"]):
        span = times[-1] - times[0]
        slowest = 1 / jnp.where(span > 0, span, 1.0)
        self.quaternion = jax.lax.stop_gradient(norm(quaternion))
        self.rate = jax.lax.stop_gradient(jnp.maximum(norm(rate), slowest))

    def pack(self, quaternion: Quat, rate: Quat) -> Float[Array, "8"]:
        """The state vector of λ and ω."""
        return jnp.concatenate([quaternion / self.quaternion, rate / self.rate])

    def unpack(self, state: Float[Array, "... 8"]) -> tuple[Float[Array, "... 4"], Float[Array, "... 4"]]:
        """λ and ω of a state vector."""
        return state[..., :4] * self.quaternion, state[..., 4:] * self.rate

    def field(self, state: Float[Array, "8"], acceleration: Quat, axes: str = "body") -> Float[Array, "8"]:
        """d/dt of the state vector [1/s] under an acceleration (4,) [rad/s²]."""
        quaternion, rate = self.unpack(state)
        return self.pack(derivative(quaternion, rate, axes), acceleration)


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
    """λ(t) and ω(t) from ε = `acceleration`(t, λ, ω), four components [rad/s²].

    `quaternion` (4,), any length but 0, and `rate` (4,) [rad/s], at the first of `times` (n,) [s]. Rate, acceleration
    and the solution's rate are in `axes`: "body" or "inertial". `solver`: a diffrax solver (None: Dopri8). `rtol` is
    relative to each component; `atol` is relative to |λ(0)| for λ, and for ω to |ω(0)| or one radian per span of time,
    whichever is faster. `jumps` (m,) [s]: instants where ε jumps, for efficiency and for derivatives in them.
    `adjoint`: a diffrax adjoint; None differentiates forwards and backwards, and for reverse differentiation in large
    batches `diffrax.RecursiveCheckpointAdjoint()` may be faster. `max_steps`: between two instants.

    A failed lane of a `vmap` is told by its `result`, and its unreached instants are NaN; `throw` raises instead.

    **Raises:** ValueError for times that do not increase strictly, or that lie so far from zero that their dtype does
    not resolve them; for λ = 0, other shapes or axes. RuntimeError with `throw` where an instant was not reached.
    """
    if axes not in ("body", "inertial"):
        raise ValueError(f"axes must be 'body' or 'inertial', but {axes!r} was given")
    quaternion, rate, times = initial_state(quaternion, rate, times)
    solution = _integrate(
        acceleration,
        quaternion,
        rate,
        times,
        None if jumps is None else as_float(jumps).astype(times.dtype),
        tolerances(rtol, atol, times),
        Method(solver, adjoint, max_steps),
        axes,
    )
    if throw:
        solution.check()
    return solution


@eqx.filter_jit
def _integrate(
    acceleration: Acceleration,
    quaternion: Quat,
    rate: Quat,
    times: Float[Array, " n"],
    jumps: Float[Array, " m"] | None,
    allowed: Tolerances,
    method: Method,
    axes: str,
) -> Solution:
    scale = Scale(quaternion, rate, times)

    def field(t: Scalar, state: Float[Array, "8"], memory: None) -> Float[Array, "8"]:
        epsilon = as_float(acceleration(t, *scale.unpack(state)))
        return scale.field(state, epsilon.astype(state.dtype), axes)

    grid, outputs = merged(times, jumps, None)
    states, _, code = ode.march(
        field, lambda k, t, y, memory: memory, scale.pack(quaternion, rate), None, grid, allowed, method
    )
    return Solution(times, *scale.unpack(states[outputs]), code)


def merged(
    times: Float[Array, " n"], jumps: Float[Array, " k"] | None, renewals: Float[Array, " m"] | None
) -> tuple[Grid, Int[Array, " n"]]:
    """A grid of all instants in order, and where the outputs lie in it.

    At one instant a renewal comes before an output. Instants before the span are moved to its start, where renewals
    still count; those after it are moved to its end and do nothing.
    """
    start = times[0]
    elapsed = times - start  # small numbers, also where the clock is far from zero
    none = jnp.zeros((0,), times.dtype)
    renewals, jumps = (none if x is None else x - start for x in (renewals, jumps))
    points = jnp.concatenate([jnp.clip(renewals, 0.0, elapsed[-1]), jnp.clip(jumps, 0.0, elapsed[-1]), elapsed])
    others = points.shape[0] - times.shape[0]
    if others == 0:
        return Grid(start, elapsed, jnp.zeros(times.shape, bool)), jnp.arange(times.shape[0])
    renews = jnp.concatenate([renewals <= elapsed[-1], jnp.zeros(jumps.shape[0] + times.shape[0], bool)])
    order = jnp.argsort(points, stable=True)
    return Grid(start, points[order], renews[order]), jnp.argsort(order, stable=True)[others:]


def initial_state(quaternion: ArrayInput, rate: ArrayInput, times: ArrayInput) -> tuple[Quat, Quat, Float[Array, " n"]]:
    """The arguments as arrays of one float dtype; ValueError for what is known to be wrong."""
    with jax.ensure_compile_time_eval():  # what is known outside a trace stays known inside
        quaternion = real_vector(quaternion, "the quaternion", 4)
        rate = real_vector(rate, "the rate", 4)
        times = as_float(times)
        require_times(times)
        known = concrete(quaternion)
        if known is not None and not known.any():
            raise ValueError("the quaternion must not be zero: it would have no attitude")
        dtype = jnp.promote_types(jnp.promote_types(quaternion.dtype, rate.dtype), times.dtype)
        return quaternion.astype(dtype), rate.astype(dtype), times.astype(dtype)


def tolerances(rtol: ArrayInput, atol: ArrayInput, times: Float[Array, " n"]) -> Tolerances:
    """Positive tolerances, no finer than a few units of round-off of the dtype."""
    epsilon = 4 * float(jnp.finfo(times.dtype).eps)
    for value, name in ((rtol, "rtol"), (atol, "atol")):
        known = concrete(value)
        if known is not None and not (np.isfinite(known).all() and (known >= 0).all()):
            raise ValueError(f"{name} must be finite and not negative, but {value!r} was given")
    relative, absolute = (as_float(x).astype(times.dtype) for x in (rtol, atol))
    return Tolerances(jnp.maximum(relative, epsilon), jnp.maximum(absolute, 0.25 * epsilon))


def require_times(times: Array) -> None:
    """Raise a ValueError where instants are no vector, do not increase, or are not resolved by their dtype."""
    if times.ndim != 1 or times.shape[0] == 0:
        raise ValueError(f"times must be a vector of instants [s], but its shape is {times.shape}")
    require_finite(times, "times")
    known = concrete(times)
    if known is None or known.size == 1:
        return
    steps = np.diff(known)
    if not (steps > 0).all():
        k = int(np.argmin(steps))
        raise ValueError(
            f"times must increase strictly, but times[{k + 1}] = {known[k + 1]:.9g} follows {known[k]:.9g}"
        )
    if steps.min() < RESOLUTION * np.spacing(np.abs(known[0])):
        raise ValueError(
            f"{known.dtype} does not resolve steps of {steps.min():.3g} s at t = {known[0]:.9g} s: measure time from "
            "the start of the motion, or call jax.config.update('jax_enable_x64', True) first"
        )
