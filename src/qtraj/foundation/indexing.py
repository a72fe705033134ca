"""Select and replace array elements at a traced index or under a traced condition.

For a traced index, the notation `x[index]` generates several times as many operations as these functions.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


def element(tree: Any, index: Int[Array, ""], axis: int = 0) -> Any:
    """Return the elements at `index` ≥ 0 along an axis, for every array of `tree`."""

    def of_array(x: Any) -> Array:
        return jax.lax.dynamic_index_in_dim(jnp.asarray(x), index, axis, keepdims=False, allow_negative_indices=False)

    return jax.tree.map(of_array, tree)


def with_element(tree: Any, index: Int[Array, ""], value: Any, axis: int = 0) -> Any:
    """Return the arrays of `tree` with the elements at `index` ≥ 0 along an axis replaced by the arrays of `value`."""

    def of_array(x: Array, value: Array) -> Array:
        return jax.lax.dynamic_update_index_in_dim(x, value, index, axis, allow_negative_indices=False)

    return jax.tree.map(of_array, tree, value)


def choose(condition: Bool[Array, " batch"], new: Any, old: Any) -> Any:
    """Return the values of `new` for batch elements where `condition` is true, and the values of `old` elsewhere."""
    return jax.tree.map(lambda x, y: jnp.where(jnp.expand_dims(condition, range(1, x.ndim)), x, y), new, old)
