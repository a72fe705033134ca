"""The least of some numbers and its place."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def min_and_argmin(values: Float[Array, "n *rest"]) -> tuple[Float[Array, "*rest"], Int[Array, "*rest"]]:
    """The least of n ≥ 1 values on the first axis, and a place where it stands.

    Any place of equal ones, and 0 where all are infinite; NaN counts as infinite. Nothing of it is differentiated.
    Several times faster than `jnp.argmin`, whose care for NaN and for the first of equal numbers keeps XLA from
    compiling plain comparisons.
    """
    known = jax.lax.stop_gradient(jnp.where(values == values, values, jnp.inf))
    places = jax.lax.broadcasted_iota(jnp.int32, values.shape, 0)

    def lesser(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
        better = b[0] < a[0]
        return jnp.where(better, b[0], a[0]), jnp.where(better, b[1], a[1])

    nothing = jnp.full((), jnp.inf, values.dtype), jnp.zeros((), places.dtype)
    return jax.lax.reduce((known, places), nothing, lesser, (0,))
