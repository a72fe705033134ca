"""Compute a function and its first two derivatives in one trace, and replace the derivatives of a value."""

from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import Array, Float


def with_derivatives(f: Callable[[Array], Any], x: Float[Array, " n"]) -> tuple[Any, Any, Any]:
    """Return f(x), ∂f/∂x and ∂²f/∂x², computed in forward mode.

    For x (n,), the first derivatives have one additional last axis of length n, and the second derivatives have two.
    """

    def value(x: Array) -> tuple[Any, Any]:
        y = f(x)
        return y, y

    def first(x: Array) -> tuple[Any, tuple[Any, Any]]:
        slopes, y = jax.jacfwd(value, has_aux=True)(x)
        return slopes, (y, slopes)

    second, (y, slopes) = jax.jacfwd(first, has_aux=True)(x)
    return y, slopes, second


@jax.custom_jvp
def with_tangent_of(value: Array, derivatives: Array) -> Array:
    """Return `value`, with the derivatives of the array `derivatives`; the value of `derivatives` is not used."""
    return value


@with_tangent_of.defjvp
def _substituted_tangent(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    return with_tangent_of(*primals), tangents[1]
