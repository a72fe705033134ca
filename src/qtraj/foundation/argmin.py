"""Compute a minimum and its index together, in a form that XLA compiles to fast code."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def min_and_argmin(values: Float[Array, "..."], axis: int = 0) -> tuple[Float[Array, "..."], Int[Array, "..."]]:
    """Return the minimum of `values` along an axis, and the index of the minimum.

    If several values are equal to the minimum, the index of any of these values may be returned. NaN counts as positive
    infinity. If all values are NaN or positive infinity, the index is 0. The result is treated as constant in
    differentiation. The function is several times faster than `jnp.argmin`, because the exact rules of `jnp.argmin` for
    NaN and equal values prevent XLA from compiling it to plain comparisons.
    """
    finite = jax.lax.stop_gradient(jnp.where(values == values, values, jnp.inf))
    indices = jax.lax.broadcasted_iota(jnp.int32, values.shape, axis)

    def smaller(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
        better = b[0] < a[0]
        return jnp.where(better, b[0], a[0]), jnp.where(better, b[1], a[1])

    initial = jnp.full((), jnp.inf, values.dtype), jnp.zeros((), indices.dtype)
    return jax.lax.reduce((finite, indices), initial, smaller, (axis,))
