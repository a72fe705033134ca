"""The checked arguments of an integration: initial state, instants, tolerances and method."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, real_vector, require_finite
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.checks import common_dtype, initial_quaternion, output_times
from qtraj.motion.simulation.ode import Grid, Method, Tolerances

RESOLUTION = 1000
"""The smallest allowed difference of two instants, in units of round-off of the first instant."""


class Task(eqx.Module):
    """The checked arguments that `integrate` and `simulate` share, in one float dtype.

    `quaternion` and `rate` [rad/s] at the first of `times` [s]; `jumps` [s]: the instants at which the right-hand side
    jumps.
    """

    quaternion: Quat
    rate: Quat
    times: Float[Array, " n"]
    jumps: Float[Array, " k"] | None
    tolerances: Tolerances
    method: Method

    def grid(self, renewals: Float[Array, " m"] | None = None) -> tuple[Grid, Int[Array, " n"]]:
        """All instants in ascending order, including `renewals` [s], and the indices of the outputs.

        At equal instants, an update precedes an output. Instants before the time span are moved to its start, where
        updates still have an effect; instants after it are moved to its end and have no effect.
        """
        start = self.times[0]
        elapsed = self.times - start  # small numbers, even if the times are far from zero
        empty = jnp.zeros((0,), elapsed.dtype)
        renewals, jumps = (empty if x is None else x - start for x in (renewals, self.jumps))
        points = jnp.concatenate([jnp.clip(renewals, 0.0, elapsed[-1]), jnp.clip(jumps, 0.0, elapsed[-1]), elapsed])
        others = points.shape[0] - elapsed.shape[0]
        if others == 0:
            return Grid(start, elapsed, jnp.zeros(elapsed.shape, bool)), jnp.arange(elapsed.shape[0])
        renews = jnp.concatenate([renewals <= elapsed[-1], jnp.zeros(jumps.shape[0] + elapsed.shape[0], bool)])
        order = jnp.argsort(points, stable=True)
        return Grid(start, points[order], renews[order]), jnp.argsort(order, stable=True)[others:]


class Scale(eqx.Module):
    """Scales by which both halves of the state are divided to be of order one; they are not differentiated.

    `quaternion`: |λ(0)|. `rate` [rad/s]: one radian per time span or |ω(0)|, whichever is larger.
    """

    quaternion: Scalar
    rate: Scalar

    def __init__(self, task: Task):
        span = task.times[-1] - task.times[0]
        min_rate = 1 / jnp.where(span > 0, span, 1.0)
        self.quaternion = jax.lax.stop_gradient(norm(task.quaternion))
        self.rate = jax.lax.stop_gradient(jnp.maximum(norm(task.rate), min_rate))

    def pack(self, quaternion: Quat, rate: Quat) -> Float[Array, "8"]:
        """The state vector of λ and ω."""
        return jnp.concatenate([quaternion / self.quaternion, rate / self.rate])

    def unpack(self, state: Float[Array, "... 8"]) -> tuple[Float[Array, "... 4"], Float[Array, "... 4"]]:
        """λ and ω of a state vector."""
        return state[..., :4] * self.quaternion, state[..., 4:] * self.rate


def checked(
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    jumps: ArrayInput | None,
    rtol: ArrayInput,
    atol: ArrayInput,
    method: Method,
) -> Task:
    """The task with these arguments; ValueError for invalid concrete values."""
    with jax.ensure_compile_time_eval():  # constants stay concrete inside a trace
        quaternion, times = initial_quaternion(quaternion), output_times(times)
        rate = real_vector(rate, "the initial rate", 4)
        _require_resolved(times)
        dtype = common_dtype(quaternion, rate, times)
        return Task(
            quaternion.astype(dtype),
            rate.astype(dtype),
            times.astype(dtype),
            None if jumps is None else _jumps(jumps).astype(dtype),
            _tolerances(rtol, atol, dtype),
            method,
        )


def _jumps(jumps: ArrayInput) -> Float[Array, " k"]:
    jumps = as_float(jumps)
    if jumps.ndim != 1:
        raise ValueError(f"jumps must be a vector of instants [s], but the shape is {jumps.shape}")
    require_finite(jumps, "jumps")
    return jumps


def _tolerances(rtol: ArrayInput, atol: ArrayInput, dtype: jnp.dtype) -> Tolerances:
    """Tolerances of at least a few units of round-off of the dtype."""
    epsilon = 4 * float(jnp.finfo(dtype).eps)
    for value, name in ((rtol, "rtol"), (atol, "atol")):
        values = concrete(value)
        if values is not None and not (np.isfinite(values).all() and (values >= 0).all()):
            raise ValueError(f"{name} must be finite and not negative, but {value!r} was given")
    relative, absolute = (as_float(x).astype(dtype) for x in (rtol, atol))
    return Tolerances(jnp.maximum(relative, epsilon), jnp.maximum(absolute, 0.25 * epsilon))


def _require_resolved(times: Float[Array, " n"]) -> None:
    """Raise a ValueError if the dtype does not resolve the differences of concrete instants far from zero."""
    values = concrete(times)
    if values is None or values.size == 1:
        return
    step = np.diff(values).min()
    if step < RESOLUTION * np.spacing(np.abs(values[0])):
        raise ValueError(
            f"{values.dtype} does not resolve steps of {step:.3g} s at t = {values[0]:.9g} s. Measure time from "
            "the start of the motion, or call jax.config.update('jax_enable_x64', True) first."
        )
