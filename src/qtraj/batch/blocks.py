"""Evaluate paths × instants in blocks whose arrays fit into the CPU cache.

Three functions combine the blocks. `filled` writes every block into buffers that are allocated once or donated; it is
not differentiable. `mapped` is differentiable; the reverse pass recomputes the intermediate values of each block, so it
needs memory only for the results and one block. `reduced` reduces each block and combines the results; it is used only
where no derivatives are needed.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

SAMPLES = 16384
"""Number of instants in a block. About forty float64 arrays of this size fit into the caches of one core, and the
arrays are long enough that the cost of starting a loop is negligible."""

Work = Callable[[Any, Any], Any]
"""A function of a batch of paths and a tree of arrays (paths or 1, instants); it returns arrays (paths, instants)."""


Write = Callable[[str, int, Array, Array, Array, Array], Array]
"""A function that writes a block into a buffer and returns the buffer.

Its arguments are name, component, buffer, values (paths, instants), and the indices of the first path and instant.
"""


Empty = Callable[[str, Any], Array]
"""A function that returns a new buffer for a name and a dtype."""


def filled(
    work: Work, empty: Empty, write: Write, paths: Any, columns: Any, shape: tuple[int, int], samples: int = SAMPLES
) -> Any:
    """Return buffers by name, filled with the components returned by `work` for every path and instant.

    `columns` is a tree of arrays (paths or 1, instants); `shape` contains the numbers of paths and instants.

    The last block overlaps the previous block if necessary, so that all blocks have the same shape.
    """
    count, instants = shape
    columns_per_block = min(instants, samples)
    rows_per_block = min(count, max(1, samples // columns_per_block))
    n_rows, n_columns = -(-count // rows_per_block), -(-instants // columns_per_block)

    def cut(p: Array, c: Array) -> Any:
        block_paths = jax.tree.map(lambda x: lax.dynamic_slice_in_dim(x, p, rows_per_block), paths)
        return block_paths, jax.tree.map(lambda x: _cut(x, p, c, rows_per_block, columns_per_block), columns)

    def block(i: Array, buffers: Any) -> Any:
        p = jnp.minimum((i // n_columns) * rows_per_block, count - rows_per_block)
        c = jnp.minimum((i % n_columns) * columns_per_block, instants - columns_per_block)
        for name, components in work(*cut(p, c)).items():
            for k, component in enumerate(components):
                buffers = buffers | {name: write(name, k, buffers[name], component, p, c)}
        return buffers

    kinds = jax.eval_shape(work, *jax.eval_shape(cut, 0, 0))
    buffers = {name: empty(name, components[0].dtype) for name, components in kinds.items()}
    return lax.fori_loop(0, n_rows * n_columns, block, buffers)


def _cut(x: Array, p: Array, c: Array, n_paths: int, n_instants: int) -> Array:
    start = (jnp.zeros_like(p), c) if x.shape[0] == 1 else (p, c)
    return lax.dynamic_slice(x, start, (min(x.shape[0], n_paths), n_instants))


def mapped(work: Work, paths: Any, columns: Any, shape: tuple[int, int], samples: int = SAMPLES) -> Any:
    """Evaluate `work` block by block and return its values (paths, instants); differentiable.

    `columns` is a tree of arrays (paths or 1, instants); `shape` contains the numbers of paths and instants.
    """
    return _map_blocks(jax.checkpoint(work), paths, columns, shape, samples, _stack_rows, _stack_columns)


def reduced(
    work: Work, join: Callable[[Any], Any], paths: Any, columns: Any, shape: tuple[int, int], samples: int = SAMPLES
) -> Any:
    """Reduce every block by `work` and combine the results by `join`, which yields one result for each path, (paths,).

    The argument of `join` is a stack of results of blocks; its first axis is the block.
    """

    def joined(main: Any, rest: Any) -> Any:
        parts = [part for part in (main, None if rest is None else _leading(rest)) if part is not None]
        return join(parts[0] if len(parts) == 1 else jax.tree.map(lambda *x: jnp.concatenate(x), *parts))

    return _map_blocks(work, paths, columns, shape, samples, _stack_rows, joined)


def _map_blocks(
    work: Work, paths: Any, columns: Any, shape: tuple[int, int], samples: int, by_path: Callable, by_time: Callable
) -> Any:
    """Evaluate blocks of whole paths if there are fewer than `samples` instants, otherwise blocks within one path.

    `by_path` combines blocks of different paths, and `by_time` combines the blocks of the same paths.
    """
    count, instants = shape
    if instants >= samples:

        def row(path: Any, columns: Any) -> Any:
            n_full = instants - instants % samples
            head = jax.tree.map(lambda x: x[:, :n_full].reshape(-1, 1, samples), columns)
            main = lax.map(lambda cut: work(path, cut), head)
            tail = jax.tree.map(lambda x: x[:, n_full:], columns)
            return by_time(main, work(path, tail) if n_full < instants else None)

        if count == 1:
            return row(paths, columns)
        return _by_paths(row, paths, columns, count, 1, by_path)
    whole_rows = lambda path, columns: by_time(_leading(work(path, columns)), None)  # noqa: E731
    return _by_paths(whole_rows, paths, columns, count, max(1, samples // instants), by_path)


def _by_paths(work: Work, paths: Any, columns: Any, count: int, n_paths: int, combine: Callable) -> Any:
    """Apply `work` to blocks of `n_paths` paths, and combine the results by `combine`."""
    shared = jax.tree.map(lambda x: x if x.shape[0] == 1 and count > 1 else None, columns)
    own = jax.tree.map(lambda x: None if x.shape[0] == 1 and count > 1 else x, columns)
    merged = lambda own: jax.tree.map(lambda a, b: b if a is None else a, own, shared, is_leaf=lambda x: x is None)  # noqa: E731
    if count <= n_paths:
        return work(paths, merged(own))
    n_full = count - count % n_paths
    head = jax.tree.map(lambda x: x[:n_full].reshape(-1, n_paths, *x.shape[1:]), (paths, own))
    main = lax.map(lambda cut: work(cut[0], merged(cut[1])), head)
    if n_full == count:
        return combine(main, None)
    tail = jax.tree.map(lambda x: x[n_full:], (paths, own))
    return combine(main, work(tail[0], merged(tail[1])))


def _leading(tree: Any) -> Any:
    return jax.tree.map(lambda x: x[None], tree)


def _stack_rows(main: Any, rest: Any) -> Any:
    """Concatenate blocks of paths (blocks, paths, …) and the remaining paths along the path axis."""
    main = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), main)
    return main if rest is None else jax.tree.map(lambda x, y: jnp.concatenate([x, y]), main, rest)


def _stack_columns(main: Any, rest: Any) -> Any:
    """Concatenate blocks (blocks, paths, instants) and the remaining instants along the time axis.

    There is either only one block or only one path.
    """
    main = jax.tree.map(lambda x: x[0] if x.shape[0] == 1 else x.reshape(1, -1), main)
    return main if rest is None else jax.tree.map(lambda x, y: jnp.concatenate([x, y], axis=1), main, rest)
