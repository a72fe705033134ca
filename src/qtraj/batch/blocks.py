"""Paths × instants in blocks that stay in the cache, written straight into the results or handed on.

Sweeps over the same blocks. `filled` writes every block into buffers that are allocated once, or were donated; it
has no derivative. `mapped` can be differentiated: a block's intermediate values are not kept but worked out again, so
the memory of a reverse pass is that of the results and of one block. `reduced` hands on parts of rows, of which no
derivatives are asked.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

SAMPLES = 16384
"""Instants in a block: some forty arrays of so many float64 lie in the caches of one core, and the price of starting a
loop is spread over enough of them."""

Work = Callable[[Any, Any], Any]
"""(a stack of paths, arrays (paths or 1, instants)) → a tree of arrays (paths, instants)."""


Write = Callable[[str, int, Array, Array, Array, Array], Array]
"""(name, component, buffer, values (paths, instants), first path, first instant) → the buffer with the values."""


def filled(
    work: Work, write: Write, paths: Any, columns: Any, shape: tuple[int, int], buffers: Any, samples: int = SAMPLES
) -> Any:
    """`buffers`, by name, with the components that `work` gives for every path and instant.

    The last block of a row overlaps the one before it, so every block has one shape.
    """
    count, instants = shape
    wide = min(instants, samples)
    high = min(count, max(1, samples // wide))
    across, along = -(-count // high), -(-instants // wide)

    def block(i: Array, buffers: Any) -> Any:
        p, c = jnp.minimum((i // along) * high, count - high), jnp.minimum((i % along) * wide, instants - wide)
        own = jax.tree.map(lambda x: lax.dynamic_slice_in_dim(x, p, high), paths)
        values = work(own, jax.tree.map(lambda x: _cut(x, p, c, high, wide), columns))
        for name, components in values.items():
            for k, component in enumerate(components):
                buffers = buffers | {name: write(name, k, buffers[name], component, p, c)}
        return buffers

    return lax.fori_loop(0, across * along, block, buffers)


def _cut(x: Array, p: Array, c: Array, high: int, wide: int) -> Array:
    start = (jnp.zeros_like(p), c) if x.shape[0] == 1 else (p, c)
    return lax.dynamic_slice(x, start, (min(x.shape[0], high), wide))


def mapped(work: Work, paths: Any, columns: Any, shape: tuple[int, int], samples: int = SAMPLES) -> Any:
    """What `work` gives, (paths, instants), by differentiable sweeps.

    `columns` is a tree of arrays (paths or 1, instants).
    """
    return _swept(jax.checkpoint(work), paths, columns, shape, samples, _rows, _columns)


def reduced(
    work: Work, join: Callable[[Any], Any], paths: Any, columns: Any, shape: tuple[int, int], samples: int = SAMPLES
) -> Any:
    """What `work` gives for each path, (paths,), from its blocks of instants; `join` takes a leading axis of blocks."""

    def joined(main: Any, rest: Any) -> Any:
        parts = [part for part in (main, None if rest is None else _leading(rest)) if part is not None]
        return join(parts[0] if len(parts) == 1 else jax.tree.map(lambda *x: jnp.concatenate(x), *parts))

    return _swept(work, paths, columns, shape, samples, _rows, joined)


def _swept(
    work: Work, paths: Any, columns: Any, shape: tuple[int, int], samples: int, by_path: Callable, by_time: Callable
) -> Any:
    """Blocks of whole rows where several fit into one, else blocks of each row; put together by the last two."""
    count, instants = shape
    if instants >= samples:

        def row(path: Any, columns: Any) -> Any:
            fits = instants - instants % samples
            head = jax.tree.map(lambda x: x[:, :fits].reshape(-1, 1, samples), columns)
            main = lax.map(lambda cut: work(path, cut), head)
            tail = jax.tree.map(lambda x: x[:, fits:], columns)
            return by_time(main, work(path, tail) if fits < instants else None)

        if count == 1:
            return row(paths, columns)
        return _by_paths(row, paths, columns, count, 1, by_path)
    whole = lambda path, columns: by_time(_leading(work(path, columns)), None)  # noqa: E731
    return _by_paths(whole, paths, columns, count, max(1, samples // instants), by_path)


def _by_paths(work: Work, paths: Any, columns: Any, count: int, high: int, put: Callable) -> Any:
    shared = jax.tree.map(lambda x: x if x.shape[0] == 1 and count > 1 else None, columns)
    own = jax.tree.map(lambda x: None if x.shape[0] == 1 and count > 1 else x, columns)
    whole = lambda own: jax.tree.map(lambda a, b: b if a is None else a, own, shared, is_leaf=lambda x: x is None)  # noqa: E731
    if count <= high:
        return work(paths, whole(own))
    fits = count - count % high
    head = jax.tree.map(lambda x: x[:fits].reshape(-1, high, *x.shape[1:]), (paths, own))
    main = lax.map(lambda cut: work(cut[0], whole(cut[1])), head)
    if fits == count:
        return put(main, None)
    tail = jax.tree.map(lambda x: x[fits:], (paths, own))
    return put(main, work(tail[0], whole(tail[1])))


def _leading(tree: Any) -> Any:
    return jax.tree.map(lambda x: x[None], tree)


def _rows(main: Any, rest: Any) -> Any:
    """Blocks of paths (blocks, high, …) one below the other, and the rest below them."""
    main = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), main)
    return main if rest is None else jax.tree.map(lambda x, y: jnp.concatenate([x, y]), main, rest)


def _columns(main: Any, rest: Any) -> Any:
    """Blocks of instants (blocks, high, wide) side by side, and the rest beside them; one block or one row."""
    main = jax.tree.map(lambda x: x[0] if x.shape[0] == 1 else x.reshape(1, -1), main)
    return main if rest is None else jax.tree.map(lambda x, y: jnp.concatenate([x, y], axis=1), main, rest)
