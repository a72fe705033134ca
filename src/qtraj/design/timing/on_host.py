"""Run a function of NumPy arrays as one operation of JAX."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from qtraj.foundation.arrays import is_traced


def on_host(function: Callable[..., Any], shapes: Any, *arguments: Any) -> Any:
    """Return the result of a function of batches: arrays whose batch axis precedes their last two axes.

    `shapes` are the shapes and types of the result for one problem; its arrays have the batch axis first. The result
    has no derivatives. A function of concrete arguments is called at once.
    """

    def of_batch(*given: Any) -> Any:
        batch = _batch(arguments, given)
        size = int(np.prod(batch))
        found = function(*jax.tree.map(lambda x: _last(np.asarray(x), batch, size), given))
        return jax.tree.map(lambda x, own: np.asarray(x.reshape((*batch, *own.shape)), own.dtype), found, shapes)

    if not is_traced(arguments):
        return of_batch(*arguments)
    return jax.pure_callback(of_batch, shapes, *arguments, vmap_method="broadcast_all")


def _batch(arguments: Any, given: Any) -> tuple[int, ...]:
    """Return the batch axes of the given arrays, of which `arguments` are those of one problem."""
    one, own = jax.tree.leaves(arguments)[0], jax.tree.leaves(given)[0]
    return own.shape[: own.ndim - one.ndim]


def _last(x: np.ndarray, batch: tuple[int, ...], size: int) -> np.ndarray:
    """Move the batch axes in front of the last two axes."""
    return np.ascontiguousarray(np.moveaxis(x.reshape(size, *x.shape[len(batch) :]), 0, -3))

