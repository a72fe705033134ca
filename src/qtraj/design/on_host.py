"""Run a function of NumPy arrays as one operation of JAX."""

import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from qtraj.foundation.arrays import is_traced


def on_host(function: Callable[..., Any], shapes: Any, *arguments: Any) -> Any:
    """Return the result of a function of batches of arrays, whose batch axis is the first axis, for one problem.

    `shapes` are the shapes and types of the result for one problem. The result has no derivatives. A function of
    concrete arguments is called at once.
    """

    def of_batch(*given: Any) -> Any:
        one, own = (jax.tree.leaves(x)[0] for x in (arguments, given))
        batch = own.shape[: own.ndim - np.ndim(one)]
        size = math.prod(batch)
        found = function(*jax.tree.map(lambda x: np.asarray(x).reshape(size, *x.shape[len(batch) :]), given))
        return jax.tree.map(lambda x, shape: np.asarray(x.reshape((*batch, *shape.shape)), shape.dtype), found, shapes)

    if not is_traced(arguments):
        return of_batch(*jax.tree.map(np.asarray, arguments))
    return host_callback(of_batch, shapes, *arguments)


def host_callback(of_batch: Callable[..., Any], shapes: Any, *arguments: Any) -> Any:
    """Call a function of batches of arrays on the host inside a trace; `vmap` adds the first axes of its arrays.

    **Raises:** ValueError for results in float64 without jax_enable_x64.
    """
    wide = any(np.dtype(x.dtype) in (np.float64, np.int64) for x in jax.tree.leaves(shapes))
    if wide and not jax.config.read("jax_enable_x64"):
        raise ValueError(
            "inside jit, grad and vmap, searches and proofs need float64, but jax_enable_x64 is False. Call "
            "jax.config.update('jax_enable_x64', True) before creating the arrays."
        )
    return jax.pure_callback(of_batch, shapes, *arguments, vmap_method="broadcast_all")
