"""Integrals over the instants of each path by the trapezoidal rule, differentiable, without storing samples.

The blocks are added elementwise, which compilers for CPUs vectorise, whereas they reduce a single block sample by
sample. Only the sum of all blocks is reduced to one number. The reverse pass recomputes each block.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from qtraj.batch.blocks import SAMPLES, Work
from qtraj.foundation.derivatives import with_tangent_of

WIDTH = 64
"""Blocks of one row are multiples of this width. Loops over other sizes take twice as long, because they do not divide
evenly into vectors and threads."""


def neighbours(times: Float[Array, "rows n"], pieces: int = 1) -> Float[Array, "rows _"]:
    """The instants before and after each of `pieces` equal pieces; at the ends of a row its first or last instant."""
    first = np.arange(pieces) * (times.shape[1] // pieces)
    after = first + times.shape[1] // pieces
    return times[:, np.stack([np.maximum(first - 1, 0), np.minimum(after, times.shape[1] - 1)], axis=1).ravel()]


def integrals(
    work: Work, paths: Any, times: Float[Array, "rows n"], around: Float[Array, "rows 2"], samples: int = SAMPLES
) -> Any:
    """The integrals, (paths,) each, of the outputs of `work` over `times` [s], one row or one for each path.

    `around` are the `neighbours` of the times, which may be part of longer rows.
    """
    count, (rows, instants) = jax.tree.leaves(paths)[0].shape[0], times.shape
    width = min(instants, samples)
    steps = -(-instants // width)
    if steps > 1 and width >= WIDTH:
        width = -(-instants // (WIDTH * steps)) * WIDTH
    # The instants appended to fill the last block have the weight 0.
    last = jnp.broadcast_to(around[:, 1:], (rows, 1 + steps * width - instants))
    row = jnp.concatenate([around[:, :1], times, last], axis=1)
    groups = max(1, -(-count // max(1, samples // width)))
    if groups == 1:
        return _integrate_group(work, paths, row, width, instants)
    own = row if rows > 1 else None
    grouped = jax.tree.map(lambda x: _in_groups(x, groups), (paths, own))
    totals = lax.map(lambda g: _integrate_group(work, g[0], row if own is None else g[1], width, instants), grouped)
    return jax.tree.map(lambda x: x.reshape(-1)[:count], totals)


def _in_groups(x: Array, groups: int) -> Array:
    """(paths, …) in equal groups (groups, paths, …); the last group is padded with copies of the last path."""
    size = -(-x.shape[0] // groups)
    padding = jnp.broadcast_to(x[-1:], (groups * size - x.shape[0], *x.shape[1:]))
    return jnp.concatenate([x, padding]).reshape(groups, size, *x.shape[1:])


def _integrate_group(work: Work, paths: Any, row: Float[Array, "rows m"], width: int, instants: int) -> Any:
    """The integrals of paths that share their blocks; `row` also has the instants before and after."""
    steps = (row.shape[1] - 2) // width
    values = lax.stop_gradient(row)

    @jax.checkpoint
    def part(paths: Any, i: Array, slopes: Any) -> Any:
        # The values are slices of the row, which copies nothing. Their derivatives are passed as separate blocks, since
        # otherwise the reverse pass would add up a whole row in every step. Without derivatives the blocks are removed.
        cuts = [lax.dynamic_slice_in_dim(values, i * width + k, width, axis=1) for k in range(3)]
        before, t, after = (with_tangent_of(cut, slope) for cut, slope in zip(cuts, slopes, strict=True))
        inside = jnp.arange(width) < instants - i * width
        weights = 0.5 * (after - before)
        return jax.tree.map(lambda x: jnp.where(inside, x.astype(row.dtype) * weights, 0.0), work(paths, (t,)))

    def step(totals: Any, cut: Any) -> Any:
        # The barrier keeps values that depend on the paths alone in the loop; computed before, they would be read from
        # memory in every step.
        step_paths, (i, slopes) = lax.optimization_barrier((paths, cut))
        return jax.tree.map(jnp.add, totals, part(step_paths, i, slopes)), None

    slopes = [jnp.moveaxis(row[:, k : k + steps * width].reshape(row.shape[0], steps, width), 1, 0) for k in range(3)]
    first = work(paths, (row[:, :width],))  # used only for its structure
    start = jax.tree.map(lambda x: jnp.zeros_like(x, dtype=row.dtype), first)
    totals, _ = lax.scan(step, start, (jnp.arange(steps), slopes))
    return jax.tree.map(lambda x: jnp.sum(x, axis=1), totals)
