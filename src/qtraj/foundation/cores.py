"""Distribute a batch over the CPU cores in blocks of equal size; a small batch has smaller blocks.

On an accelerator, the whole batch is one block, whose size is a power of two.

Each block is an independent call of one compiled function. With two block sizes, two executables are enough for batches
of any size. The arrays of a block are small enough for the CPU cache.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from qtraj.foundation.devices import chosen_device, default_platform

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

SIZES = (8, 64)
"""Block sizes for a small batch and for a large batch; arrays of 64 elements still fit into the CPU cache."""

MAX_SMALL_BATCH = 32
"""Maximum number of elements per core in a small batch."""


def block_size(elements: int) -> int:
    """Return the block size for a batch with this number of `elements`; an accelerator computes all in one block."""
    if default_platform() != "cpu":
        return 1 << max(elements - 1, 0).bit_length()
    return SIZES[0] if elements <= MAX_SMALL_BATCH * CORES else SIZES[1]


def split(indices: np.ndarray, size: int) -> list[np.ndarray]:
    """Divide the indices of the batch elements into blocks of `size`; the last block may be smaller."""
    return [indices[k : k + size] for k in range(0, indices.size, size)]


def take(tree: Any, block: np.ndarray, size: int) -> Any:
    """Select the elements of a block from all arrays, and pad the block to `size` with copies of its first element."""
    padded = np.concatenate([block, np.full(size - block.size, block[0])])
    return jax.tree.map(lambda x: x[padded], tree)


def map_blocks(call: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], device: Any = None) -> Iterator[Any]:
    """Yield the results of `call` for each tuple of arguments, in order, as NumPy arrays.

    Every call uses `device`, or JAX's default device if `device` is None.
    """
    x64 = bool(jax.config.read("jax_enable_x64"))
    used_device = device or chosen_device()

    def one(block_arguments: tuple[Any, ...]) -> Any:
        with jax.enable_x64(x64), jax.default_device(used_device):  # threads do not inherit these settings
            return jax.tree.map(np.asarray, call(*block_arguments))

    if not arguments:
        return
    signature = hash((call, x64, used_device, _signature(arguments[0])))
    n_first = 0 if signature in _compiled else 1  # the first call compiles, which only one thread should do
    yield from map(one, arguments[:n_first])
    _compiled.add(signature)
    rest = arguments[n_first:]
    if len(rest) < 2:
        yield from map(one, rest)
        return
    # Create a new pool for each call, which takes only 0.1 ms. The threads of a persistent pool do not exist in a
    # forked process, which would wait for them forever.
    with ThreadPoolExecutor(CORES, thread_name_prefix="qtraj") as pool:
        yield from pool.map(one, rest)


_compiled: set[int] = set()
"""Hashes of the function, the settings, and the structure and shapes of the arguments, for all calls made so far."""


def _signature(arguments: tuple[Any, ...]) -> Any:
    leaves, structure = jax.tree.flatten(arguments)
    return structure, tuple((x.shape, x.dtype.name) if isinstance(x, np.ndarray | jax.Array) else x for x in leaves)
