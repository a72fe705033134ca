"""Many lanes shared out to the cores: in blocks of one size, as independent calls of one compiled function.

What is compiled for a block serves any number of lanes, and a block is small enough to stay in the cache.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

SIZES = (8, 64)
"""Lanes of a block where there are few and where there are many; so many still stay in the cache."""

FEW = 32
"""So many lanes for each core are few."""


def block_size(lanes: int) -> int:
    """The size of the blocks in which so many lanes are worked on."""
    return SIZES[0] if lanes <= FEW * CORES else SIZES[1]


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


def allocate(lanes: int, found: Any) -> Any:
    """Arrays for all lanes like those found for a block."""
    return jax.tree.map(lambda x: np.zeros((lanes, *x.shape[1:]), x.dtype), found)


def map_blocks(call: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], device: Any = None) -> Iterator[Any]:
    """NumPy arrays of what `call` gives for each of the arguments, in their order, on one `jax.Device`."""
    x64 = bool(jax.config.read("jax_enable_x64"))
    place = device or jax.config.jax_default_device  # type: ignore[attr-defined]

    def one(given: tuple[Any, ...]) -> Any:
        with jax.enable_x64(x64), jax.default_device(place):  # a thread does not have the settings of its parent
            return jax.tree.map(np.asarray, call(*given))

    if not arguments:
        return
    kind = hash((call, x64, place, _kind(arguments[0])))
    alone = 0 if kind in _compiled else 1  # or several threads would compile the same
    yield from map(one, arguments[:alone])
    _compiled.add(kind)
    rest = arguments[alone:]
    if len(rest) < 2:  # no two can share the cores
        yield from map(one, rest)
        return
    # Threads that stayed would be lost in a forked process, which would wait for them for ever; new ones cost 0.1 ms.
    with ThreadPoolExecutor(CORES, thread_name_prefix="qtraj") as pool:
        yield from pool.map(one, rest)


_compiled: set[int] = set()
"""The calls, and the structures and shapes of their arguments, that have been made before."""


def _kind(given: tuple[Any, ...]) -> Any:
    leaves, structure = jax.tree.flatten(given)
    return structure, tuple((x.shape, x.dtype.name) if isinstance(x, np.ndarray) else x for x in leaves)
