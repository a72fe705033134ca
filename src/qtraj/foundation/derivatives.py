"""A function with its first two derivatives, traced once for all of them."""

from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import Array, Float


def with_derivatives(f: Callable[[Array], Any], x: Float[Array, " n"]) -> tuple[Any, Any, Any]:
    """f(x) of any structure, ∂f/∂x and ∂²f/∂x², whose arrays have one and two further axes of n; forward mode."""

    def value(x: Array) -> tuple[Any, Any]:
        y = f(x)
        return y, y

    def first(x: Array) -> tuple[Any, tuple[Any, Any]]:
        slopes, y = jax.jacfwd(value, has_aux=True)(x)
        return slopes, (y, slopes)

    second, (y, slopes) = jax.jacfwd(first, has_aux=True)(x)
    return y, slopes, second
