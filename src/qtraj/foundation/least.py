"""The least of some numbers and its place."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.foundation.types import Scalar


def least(values: Float[Array, " n"]) -> tuple[Scalar, Int[Array, ""]]:
    """The least of n ≥ 1 values and a place where it stands: any one of equal ones, and 0 where all are infinite.

    NaN counts as infinite. Nothing of it is differentiated. Several times faster than `jnp.argmin`, whose care for NaN
    and for the first of equal numbers keeps XLA from compiling plain comparisons.
    """
    known = jax.lax.stop_gradient(jnp.where(values == values, values, jnp.inf))
    places = jnp.arange(values.shape[0])

    def lesser(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
        better = b[0] < a[0]
        return jnp.where(better, b[0], a[0]), jnp.where(better, b[1], a[1])

    nothing = jnp.full((), jnp.inf, values.dtype), jnp.zeros((), places.dtype)
    return jax.lax.reduce((known, places), nothing, lesser, (0,))


def place_of_largest(values: Float[Array, " n"]) -> Int[Array, ""]:
    """A place of the largest of n ≥ 1 values, as `least` finds it."""
    return least(-values)[1]
