"""Integrate over the instants of each path by the trapezoidal rule, differentiably, without storing samples.

The blocks of samples are added elementwise, because CPU compilers vectorise elementwise operations, but sum a single
block sample by sample. Only the sum of all blocks is then summed to one number. The reverse pass recomputes each block.
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
"""If a row has several blocks, the number of instants in a block is a multiple of this number.

Loops over other sizes take twice as long, because these sizes do not divide evenly into vectors and threads.
"""


def neighbours(times: Float[Array, "rows n"], pieces: int = 1) -> Float[Array, "rows _"]:
    """Return the instants before and after each of `pieces` equal segments of every row of `times`.

    The first and the last instant of a row count as their own neighbours.
    """
    first = np.arange(pieces) * (times.shape[1] // pieces)
    after = first + times.shape[1] // pieces
    return times[:, np.stack([np.maximum(first - 1, 0), np.minimum(after, times.shape[1] - 1)], axis=1).ravel()]


def integrals(
    work: Work, paths: Any, times: Float[Array, "rows n"], around: Float[Array, "rows 2"], samples: int = SAMPLES
) -> Any:
    """Return the integrals (paths,) of the outputs of `work` over `times` [s].

    `times` has one row for all paths, or one row for each path. The rows may be segments of longer rows, so `around`
    contains their `neighbours`.
    """
    count, (rows, instants) = jax.tree.leaves(paths)[0].shape[0], times.shape
    width = min(instants, samples)
    steps = -(-instants // width)
    if steps > 1 and width >= WIDTH:
        width = -(-instants // (WIDTH * steps)) * WIDTH
    # The instants appended to fill the last block have weight 0.
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
    """Divide (paths, …) into equal groups (groups, paths, …), padding the last group with copies of the last path."""
    size = -(-x.shape[0] // groups)
    padding = jnp.broadcast_to(x[-1:], (groups * size - x.shape[0], *x.shape[1:]))
    return jnp.concatenate([x, padding]).reshape(groups, size, *x.shape[1:])


def _integrate_group(work: Work, paths: Any, row: Float[Array, "rows m"], width: int, instants: int) -> Any:
    """Return the integrals of paths that share blocks; `row` also contains the instants before and after the times."""
    steps = (row.shape[1] - 2) // width
    values = lax.stop_gradient(row)

    @jax.checkpoint
    def part(paths: Any, i: Array, slopes: Any) -> Any:
        # The times are slices of the row, which need no copy. The derivatives of the times are passed as separate
        # blocks, because otherwise the reverse pass would sum a whole row in every step. If there are no derivatives,
        # the compiler removes the separate blocks.
        cuts = [lax.dynamic_slice_in_dim(values, i * width + k, width, axis=1) for k in range(3)]
        before, t, after = (with_tangent_of(cut, slope) for cut, slope in zip(cuts, slopes, strict=True))
        inside = jnp.arange(width) < instants - i * width
        weights = 0.5 * (after - before)
        return jax.tree.map(lambda x: jnp.where(inside, x.astype(row.dtype) * weights, 0.0), work(paths, (t,)))

    def step(totals: Any, cut: Any) -> Any:
        # The barrier keeps inside the loop all values that depend only on the paths. If they were computed before the
        # loop, they would be read from memory in every step.
        step_paths, (i, slopes) = lax.optimization_barrier((paths, cut))
        return jax.tree.map(jnp.add, totals, part(step_paths, i, slopes)), None

    slopes = [jnp.moveaxis(row[:, k : k + steps * width].reshape(row.shape[0], steps, width), 1, 0) for k in range(3)]
    first = work(paths, (row[:, :width],))  # only the structure of the result is used
    start = jax.tree.map(lambda x: jnp.zeros_like(x, dtype=row.dtype), first)
    totals, _ = lax.scan(step, start, (jnp.arange(steps), slopes))
    return jax.tree.map(lambda x: jnp.sum(x, axis=1), totals)
