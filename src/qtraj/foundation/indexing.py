"""Select and replace array elements at a traced index or under a traced condition.

The notation of NumPy, `x[index]`, compiles to several times as many operations for a traced index.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


def element(tree: Any, index: Int[Array, ""], axis: int = 0) -> Any:
    """The elements of every array in `tree` at `index` ≥ 0 along an axis."""

    def of_array(x: Any) -> Array:
        return jax.lax.dynamic_index_in_dim(jnp.asarray(x), index, axis, keepdims=False, allow_negative_indices=False)

    return jax.tree.map(of_array, tree)


def with_element(tree: Any, index: Int[Array, ""], value: Any, axis: int = 0) -> Any:
    """The arrays of `tree` with their elements at `index` ≥ 0 along an axis replaced by the arrays of `value`."""

    def of_array(x: Array, value: Array) -> Array:
        return jax.lax.dynamic_update_index_in_dim(x, value, index, axis, allow_negative_indices=False)

    return jax.tree.map(of_array, tree, value)


def choose(condition: Bool[Array, " batch"], new: Any, old: Any) -> Any:
    """For each batch element, the arrays of `new` if the condition is true, otherwise those of `old`."""
    return jax.tree.map(lambda x, y: jnp.where(jnp.expand_dims(condition, range(1, x.ndim)), x, y), new, old)
