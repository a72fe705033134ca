"""Check the inputs for the propagation and the integration of attitudes."""

import contextlib
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_seconds, concrete, real_vector, require_finite
from qtraj.foundation.namespace import is_host, xp
from qtraj.foundation.types import ArrayInput, Quat
from qtraj.path.rate_axes import require_axes as require_axes

MAX_ANGLE_ERROR = 0.01
"""[rad] The largest rounding error of the total angle of a rotation."""


def output_times(times: ArrayInput, from_first: bool = False) -> Float[Array, " n"]:
    """Return the instants (n,) [s], n ≥ 1, as a float vector.

    With `from_first`, absolute times count from the first of them.

    **Raises:** ValueError for another shape, and for concrete values that are not finite or not strictly increasing.
    """
    times = as_seconds(times, from_first)
    times = times.astype(common_dtype(times))
    if times.ndim != 1 or times.shape[0] == 0:
        raise ValueError(f"times must be a non-empty vector of instants [s], but shape {times.shape} was given")
    require_finite(times, "times")
    values = concrete(times)
    if values is not None and np.any(late := np.diff(values) <= 0):
        i = int(np.argmax(late))
        raise ValueError(
            f"times must increase strictly, but times[{i + 1}] = {values[i + 1]:.9g} s follows "
            f"times[{i}] = {values[i]:.9g} s"
        )
    return times


def initial_quaternion(quaternion: ArrayInput) -> Quat:
    """Return the initial quaternion λ (4,) as a float array, without normalising λ.

    **Raises:** ValueError if λ is zero or not finite, or has another shape.
    """
    quaternion = real_vector(quaternion, "the initial quaternion", 4)
    values = concrete(quaternion)
    if values is not None and not values.any():
        raise ValueError("the initial quaternion must not be zero, because zero does not represent an attitude")
    return quaternion


def initial_rate(rate: ArrayInput) -> Quat:
    """Return the initial rate (4,) [rad/s] as a float array; a rate (3,) gets the scalar part zero.

    **Raises:** ValueError if the rate is not finite, or has another shape.
    """
    shape = np.shape(rate)
    if shape == (3,):
        vector = real_vector(rate, "the initial rate", 3)
        return xp.concatenate([xp.zeros_like(vector[:1]), vector])
    if shape != (4,):
        raise ValueError(f"the initial rate must have shape (3,) or (4,), but an array of shape {shape} was given")
    return real_vector(rate, "the initial rate", 4)


def common_dtype(*arrays: jax.Array) -> jnp.dtype:
    """Return the dtype in which JAX computes with the arrays: the widest, or float32 without JAX's 64-bit mode.

    With strict promotion, JAX rejects mixed dtypes.
    """
    return jax.dtypes.canonicalize_dtype(functools.reduce(np.promote_types, (x.dtype for x in arrays)))


def shared_dtype(*arrays: Array) -> jnp.dtype:
    """Return the widest dtype of NumPy arrays; with JAX arrays, the widest dtype in which JAX computes."""
    if is_host(*arrays):
        return functools.reduce(np.promote_types, (x.dtype for x in arrays))
    return common_dtype(*arrays)


def require_precise_angle(angle: Array, name: str) -> None:
    """Raise a ValueError for a concrete angle [rad] that is too large to determine an attitude in its dtype."""
    value = concrete(angle)
    largest = MAX_ANGLE_ERROR / float(np.finfo(angle.dtype).eps)
    if value is not None and not abs(value) <= largest:
        raise ValueError(
            f"{name} must be at most {largest:.3g} rad in {angle.dtype}, because larger angles have rounding errors of "
            f"more than {MAX_ANGLE_ERROR:g} rad, but {float(value):.9g} rad was given"
        )


def at_once() -> contextlib.AbstractContextManager:
    """Return a context in which operations on concrete values have concrete results, even inside a trace."""
    traced = concrete(jax.device_put(np.zeros(()))) is None  # unlike an operation, it compiles nothing
    return jax.ensure_compile_time_eval() if traced else contextlib.nullcontext()
