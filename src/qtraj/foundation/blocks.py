"""Many lanes in blocks of one size: independent calls of one compiled function, which the cores share.

What is compiled for a block serves any number of lanes, and a block is small enough to stay in the cache.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

CORES = os.cpu_count() or 1


def split(lanes: np.ndarray, size: int) -> list[np.ndarray]:
    """The indices of the lanes, block after block; the last may have fewer."""
    return [lanes[k : k + size] for k in range(0, lanes.size, size)]


def take(tree: Any, block: np.ndarray, size: int) -> Any:
    """The lanes of a block from all arrays, filled up with its first to the size for which the call is compiled."""
    full = np.concatenate([block, np.full(size - block.size, block[0])])
    return jax.tree.map(lambda x: x[full], tree)


def put(tree: Any, block: np.ndarray, found: Any) -> None:
    """What was found for a block into the arrays of all lanes."""
    for whole, part in zip(jax.tree.leaves(tree), jax.tree.leaves(found), strict=True):
        whole[block] = part[: block.size]


def room(lanes: int, found: Any) -> Any:
    """Arrays for all lanes like those found for a block."""
    return jax.tree.map(lambda x: np.zeros((lanes, *x.shape[1:]), x.dtype), found)


def each(call: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
    """NumPy arrays of what `call` gives for each of the arguments, in their order."""
    x64 = bool(jax.config.read("jax_enable_x64"))

    def one(given: tuple[Any, ...]) -> Any:
        with jax.enable_x64(x64):  # a thread does not have the settings of its parent
            return jax.tree.map(np.asarray, call(*given))

    kind = (call, x64, _kind(arguments[0]))
    alone = 0 if kind in _known else 1  # or several threads would compile the same
    yield from map(one, arguments[:alone])
    _known.add(kind)
    with ThreadPoolExecutor(CORES) as pool:
        yield from pool.map(one, arguments[alone:])


_known: set[Any] = set()
"""The calls, and the structures and shapes of their arguments, that have been compiled."""


def _kind(given: tuple[Any, ...]) -> Any:
    leaves, structure = jax.tree.flatten(given)
    return structure, tuple((x.shape, x.dtype.name) if isinstance(x, np.ndarray) else type(x) for x in leaves)
