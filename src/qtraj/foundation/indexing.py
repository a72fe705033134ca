"""Elements at an index that only compiled code knows. NumPy's notation compiles to several times as many operations."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int


def element(tree: Any, index: Int[Array, ""], axis: int = 0) -> Any:
    """The elements at `index` ≥ 0 along an axis of every array."""

    def of_array(x: Any) -> Array:
        return jax.lax.dynamic_index_in_dim(jnp.asarray(x), index, axis, keepdims=False, allow_negative_indices=False)

    return jax.tree.map(of_array, tree)


def with_element(tree: Any, index: Int[Array, ""], value: Any, axis: int = 0) -> Any:
    """The arrays of `tree` with those of `value` at `index` ≥ 0 along an axis."""

    def of_array(x: Array, value: Array) -> Array:
        return jax.lax.dynamic_update_index_in_dim(x, value, index, axis, allow_negative_indices=False)

    return jax.tree.map(of_array, tree, value)
