"""Searches inside a trace: one operation of JAX, which calls the search of the host.

`jax.pure_callback` adds the batch axes of `jax.vmap` to the arrays; they are joined to one axis for the search.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.design.on_host import host_callback
from qtraj.design.tuning import multistart
from qtraj.design.tuning.search import AbstractSearch, SearchResult
from qtraj.design.tuning.searches import searches_of
from qtraj.design.tuning.task import Task


def solve(method: AbstractSearch, tasks: Task, posed: Any, starts: int, max_steps: int) -> SearchResult:
    """Return the best results of a batch of traced tasks, which are treated as constants; see `multistart.solve`."""
    arrays, static = eqx.partition((jax.lax.stop_gradient(tasks), posed), eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    shapes = [x.shape for x in leaves]
    count, n = tasks.low.shape
    dtype = tasks.low.dtype

    def result_shapes(batch: tuple[int, ...]) -> SearchResult:
        def array(kind: Any, *more: int) -> Any:
            return jax.ShapeDtypeStruct((*batch, *more), kind)

        k = n + 1
        return SearchResult(
            array(dtype, n), array(np.int32, k), array(dtype, k), array(dtype, k), array(dtype), array(bool),
            array(np.int32), array(dtype), array(np.int32),
        )  # fmt: skip

    def on_host(*values: Any) -> SearchResult:
        hosts = [np.asarray(x) for x in values]
        more = hosts[0].shape[: hosts[0].ndim - len(shapes[0])]
        joined = [x.reshape(-1, *shape[1:]) for x, shape in zip(hosts, shapes, strict=True)]
        own, valid = eqx.combine(jax.tree.unflatten(structure, joined), static)
        searches = searches_of(own.problem, own.limits, own.low, own.high)
        found = multistart.solve(method, searches, starts, max_steps, posed=valid)
        expected = result_shapes((*more, count))
        return jax.tree.map(lambda x, like: np.asarray(x, like.dtype).reshape(like.shape), found, expected)

    return host_callback(on_host, result_shapes((count,)), *map(jnp.asarray, leaves))
