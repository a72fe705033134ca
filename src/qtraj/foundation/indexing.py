"""Elements of arrays at an index, or under a condition, that only compiled code knows.

NumPy's notation for such an index compiles to several times as many operations.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


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


def choose(condition: Bool[Array, " batch"], new: Any, old: Any) -> Any:
    """The elements of a batch from the arrays of `new` where the condition is true, elsewhere from those of `old`."""
    return jax.tree.map(lambda x, y: jnp.where(jnp.expand_dims(condition, range(1, x.ndim)), x, y), new, old)
