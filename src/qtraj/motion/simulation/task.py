"""Check the arguments of an integration: initial state, instants, tolerances and method."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, require_finite
from qtraj.foundation.namespace import in_numpy, stop_gradient, xp
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.checks import common_dtype, initial_quaternion, initial_rate, output_times
from qtraj.motion.simulation.interval import Method, Tolerances
from qtraj.motion.simulation.ode import Grid
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route

RESOLUTION = 1000
"""Minimum difference of two instants, in units of round-off of the first instant."""


class Task(eqx.Module):
    """The checked arguments that are common to `integrate` and `simulate`, in one float dtype.

    `quaternion` and `rate` [rad/s] are the state at times[0]; `jumps` [s] are the instants at which the right-hand side
    is discontinuous.
    """

    quaternion: Quat
    rate: Quat
    times: Float[Array, " n"]
    jumps: Float[Array, " k"] | None
    tolerances: Tolerances
    method: Method


@in_numpy
def merged_grid(times: Any, jumps: Any, renewals: Any = None) -> tuple[Grid, Int[Array, " n"]]:
    """Return the grid of all instants, and the indices of the output instants `times` [s].

    The grid also contains the `jumps` [s] and the `renewals` [s], the instants of updates. At equal instants, an update
    precedes an output. Instants before the time span are moved to the start of the span, where updates still have an
    effect; instants after the span are moved to its end and have no effect.
    """
    start = times[0]
    elapsed = times - start  # small numbers, even if the times are far from zero
    empty = elapsed[:0]
    renewals, jumps = (empty if x is None else x - start for x in (renewals, jumps))
    points = xp.concatenate([xp.clip(renewals, 0.0, elapsed[-1]), xp.clip(jumps, 0.0, elapsed[-1]), elapsed])
    others = points.shape[0] - elapsed.shape[0]
    if others == 0:
        return Grid(start, elapsed, xp.zeros(elapsed.shape, bool)), xp.arange(elapsed.shape[0])
    renews = xp.concatenate([renewals <= elapsed[-1], np.zeros(jumps.shape[0] + elapsed.shape[0], bool)])
    order = xp.argsort(points, stable=True)
    return Grid(start, points[order], renews[order]), xp.argsort(order, stable=True)[others:]


class Scale(eqx.Module):
    """The scales by which λ and ω are divided, so that the state is of order one; they are not differentiated.

    `quaternion` is |λ(0)|. `rate` [rad/s] is the larger of |ω(0)| and one radian per time span.
    """

    quaternion: Scalar
    rate: Scalar

    def pack(self, quaternion: Quat, rate: Quat) -> Float[Array, "8"]:
        """Return the state vector of λ and ω."""
        return xp.concatenate([quaternion / self.quaternion, rate / self.rate])

    def unpack(self, state: Float[Array, "... 8"]) -> tuple[Float[Array, "... 4"], Float[Array, "... 4"]]:
        """Return λ and ω of a state vector."""
        return state[..., :4] * self.quaternion, state[..., 4:] * self.rate


class Setup(eqx.Module):
    """A task with the values that are computed before the integration.

    `outputs` (n,) are the indices of the output instants in `grid`.
    """

    task: Task
    scale: Scale
    grid: Grid
    outputs: Int[Array, " n"]

    @property
    def times(self) -> Float[Array, " n"]:
        """The output instants [s]."""
        return self.task.times

    @property
    def start(self) -> Float[Array, "8"]:
        """The initial state vector of λ and ω."""
        return self.scale.pack(self.task.quaternion, self.task.rate)


def setup(task: Task, renewals: Float[Array, " m"] | None = None) -> Setup:
    """Compute the scales of a task, and the grid of its instants and of the updates `renewals` [s]."""
    scale = _scale(task.quaternion, task.rate, task.times)
    return Setup(task, scale, *merged_grid(task.times, task.jumps, renewals))


@in_numpy
def _scale(quaternion: Quat, rate: Quat, times: Float[Array, " n"]) -> Scale:
    span = times[-1] - times[0]
    min_rate = 1 / xp.where(span > 0, span, 1.0)
    return Scale(stop_gradient(norm(quaternion)), stop_gradient(xp.maximum(norm(rate), min_rate)))


def checked(
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    jumps: ArrayInput | None,
    rtol: ArrayInput,
    atol: ArrayInput,
    method: Method,
) -> Task:
    """Return the arguments as a `Task` in one float dtype; raise a ValueError for invalid concrete values."""
    with jax.ensure_compile_time_eval():  # constants stay concrete inside a trace
        quaternion, times = initial_quaternion(quaternion), output_times(times)
        rate = initial_rate(rate)
        dtype = jax.dtypes.canonicalize_dtype(common_dtype(quaternion, rate, times))
        _require_resolved(times, dtype)
        return Task(
            quaternion.astype(dtype),
            rate.astype(dtype),
            times.astype(dtype),
            None if jumps is None else checked_jumps(jumps).astype(dtype),
            checked_tolerances(rtol, atol, dtype),
            method,
        )


def switches_of(*parts: Any) -> Float[Array, " m"] | None:
    """Return the instants [s] at which the accelerations of programs jump, and the knots of paths.

    The result is None if there are no concrete instants. Traced instants are omitted, because there may be many of
    them; the step control of the solver finds these jumps.
    """
    instants = [getattr(part, "switches", None) for part in parts]
    paths = [part for part in parts if isinstance(part, AbstractHodograph)]
    instants += [path.times if isinstance(path, Route) else path.nodes() for path in paths]
    known = [np.ravel(x) for x in map(_concrete_or_none, instants) if x is not None]
    return xp.unique(np.concatenate(known)) if known else None


def _concrete_or_none(x: Any) -> np.ndarray | None:
    return None if x is None else concrete(x)


def within(times: Float[Array, " n"], jumps: Float[Array, " k"] | None) -> Float[Array, " m"] | None:
    """Return the jumps inside the time span; return all jumps if `times` or `jumps` are traced.

    A jump outside the time span would only add an empty interval.
    """
    span, values = concrete(times), _concrete_or_none(jumps)
    if jumps is None or span is None or values is None:
        return jumps
    return xp.asarray(values[(values > span[0]) & (values < span[-1])])


def checked_jumps(jumps: ArrayInput) -> Float[Array, " k"]:
    """Return the instants of jumps as a vector [s].

    **Raises:** ValueError for another shape, or values that are not finite.
    """
    jumps = as_float(jumps)
    if jumps.ndim != 1:
        raise ValueError(f"jumps must be a vector of instants [s], but shape {jumps.shape} was given")
    require_finite(jumps, "jumps")
    return jumps


def checked_tolerances(rtol: ArrayInput, atol: ArrayInput, dtype: jnp.dtype) -> Tolerances:
    """Return the tolerances, increased to at least a few units of round-off of the dtype."""
    epsilon = 4 * float(jnp.finfo(dtype).eps)
    for value, name in ((rtol, "rtol"), (atol, "atol")):
        values = concrete(value)
        if values is not None and not (np.isfinite(values).all() and (values >= 0).all()):
            raise ValueError(f"{name} must be finite and not negative, but {value!r} was given")
    relative, absolute = (as_float(x).astype(dtype) for x in (rtol, atol))
    return Tolerances(xp.maximum(relative, epsilon), xp.maximum(absolute, 0.25 * epsilon))


def _require_resolved(times: Float[Array, " n"], dtype: jnp.dtype) -> None:
    """Raise a ValueError if `dtype` does not resolve the differences of concrete instants far from zero."""
    values = concrete(times)
    if values is None or values.size == 1:
        return
    step = np.diff(values).min()
    if step < RESOLUTION * np.spacing(np.abs(values[0]).astype(dtype)):
        raise ValueError(
            f"{dtype} does not resolve the smallest step of times, {step:.3g} s, at t = {values[0]:.9g} s. "
            "Measure time from the start of the motion, or call jax.config.update('jax_enable_x64', True) first."
        )
