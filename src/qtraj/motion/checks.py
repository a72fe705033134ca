"""What the propagation and the integration of an attitude ask of their input alike."""

import contextlib
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, concrete, real_vector, require_finite
from qtraj.foundation.types import ArrayInput, Quat
from qtraj.path.rate_axes import require_axes as require_axes


def output_times(times: ArrayInput) -> Float[Array, " n"]:
    """Instants (n,) [s], n ≥ 1, as a float vector.

    **Raises:** ValueError for another shape, and where they are known and not finite or not strictly increasing.
    """
    times = as_float(times)
    if times.ndim != 1 or times.shape[0] == 0:
        raise ValueError(f"times must be a vector of at least one instant [s], but have shape {times.shape}")
    require_finite(times, "times")
    known = concrete(times)
    if known is not None and np.any(late := np.diff(known) <= 0):
        i = int(np.argmax(late))
        raise ValueError(
            f"times must increase strictly, but times[{i}] = {known[i]:.9g} s is followed by {known[i + 1]:.9g} s"
        )
    return times


def initial_quaternion(quaternion: ArrayInput) -> Quat:
    """The first λ (4,), of any length but zero (ValueError for zero, other shapes, and what is not finite)."""
    quaternion = real_vector(quaternion, "the initial quaternion", 4)
    known = concrete(quaternion)
    if known is not None and not known.any():
        raise ValueError("the initial quaternion must not be zero: it would have no attitude")
    return quaternion


def common_dtype(*arrays: jax.Array) -> jnp.dtype:
    """The widest float among them (JAX's own rule refuses to mix under strict promotion)."""
    return functools.reduce(np.promote_types, (x.dtype for x in arrays))


def at_once() -> contextlib.AbstractContextManager:
    """Lets a program that is being traced compute what it knows already."""
    staged = concrete(jnp.zeros(())) is None
    return jax.ensure_compile_time_eval() if staged else contextlib.nullcontext()
