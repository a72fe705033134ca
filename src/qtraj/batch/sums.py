"""Integrals over the instants of each path by the trapezoidal rule, with derivatives; no sample is kept.

The samples of a block lie side by side, and each place adds up its own from block to block: elementwise work, which
compilers for CPUs vectorise, where they reduce a block to one number sample by sample. The reverse pass works each
block out again.
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
"""Blocks of one row are multiples of it: of a size that vectors and threads do not divide, loops take twice as long."""


def neighbours(times: Float[Array, "rows n"], pieces: int = 1) -> Float[Array, "rows _"]:
    """For each of so many equal pieces the instant before and the one after; at the ends of a row its first or last."""
    first = np.arange(pieces) * (times.shape[1] // pieces)
    after = first + times.shape[1] // pieces
    return times[:, np.stack([np.maximum(first - 1, 0), np.minimum(after, times.shape[1] - 1)], axis=1).ravel()]


def integrals(
    work: Work, paths: Any, times: Float[Array, "rows n"], around: Float[Array, "rows 2"], samples: int = SAMPLES
) -> Any:
    """The integrals over `times` [s], one row or one for each path, of what `work` gives: (paths,) each.

    `around` are the `neighbours` of the times: these may be a piece of longer rows.
    """
    count, (rows, instants) = jax.tree.leaves(paths)[0].shape[0], times.shape
    wide = min(instants, samples)
    steps = -(-instants // wide)
    if steps > 1 and wide >= WIDTH:
        wide = -(-instants // (WIDTH * steps)) * WIDTH
    # What is appended to fill the last block weighs nothing.
    last = jnp.broadcast_to(around[:, 1:], (rows, 1 + steps * wide - instants))
    row = jnp.concatenate([around[:, :1], times, last], axis=1)
    groups = max(1, -(-count // max(1, samples // wide)))
    if groups == 1:
        return _together(work, paths, row, wide, instants)
    own = row if rows > 1 else None
    given = jax.tree.map(lambda x: _in_groups(x, groups), (paths, own))
    found = lax.map(lambda of: _together(work, of[0], row if own is None else of[1], wide, instants), given)
    return jax.tree.map(lambda x: x.reshape(-1)[:count], found)


def _in_groups(x: Array, groups: int) -> Array:
    """(paths, …) in equal groups (groups, paths, …), the last of them filled up with the last path."""
    high = -(-x.shape[0] // groups)
    more = jnp.broadcast_to(x[-1:], (groups * high - x.shape[0], *x.shape[1:]))
    return jnp.concatenate([x, more]).reshape(groups, high, *x.shape[1:])


def _together(work: Work, paths: Any, row: Float[Array, "rows m"], wide: int, instants: int) -> Any:
    """The integrals of paths that share their blocks; `row` holds what comes before and after the instants too."""
    steps = (row.shape[1] - 2) // wide
    values = lax.stop_gradient(row)

    @jax.checkpoint
    def part(paths: Any, i: Array, slopes: Any) -> Any:
        # The values are cut from the row, which copies nothing. Their derivatives come as blocks of their own: else the
        # reverse pass would add up a whole row in every step. Where the times have none, nothing is left of these.
        cuts = [lax.dynamic_slice_in_dim(values, i * wide + k, wide, axis=1) for k in range(3)]
        before, t, after = (with_tangent_of(cut, slope) for cut, slope in zip(cuts, slopes, strict=True))
        inside = jnp.arange(wide) < instants - i * wide
        weights = 0.5 * (after - before)
        return jax.tree.map(lambda x: jnp.where(inside, x.astype(row.dtype) * weights, 0.0), work(paths, (t,)))

    def step(so_far: Any, cut: Any) -> Any:
        # Tied to the step: what depends on the paths alone would be worked out before the loop, and then read in it.
        now, (i, slopes) = lax.optimization_barrier((paths, cut))
        return jax.tree.map(jnp.add, so_far, part(now, i, slopes)), None

    slopes = [jnp.moveaxis(row[:, k : k + steps * wide].reshape(row.shape[0], steps, wide), 1, 0) for k in range(3)]
    first = work(paths, (row[:, :wide],))  # for its form alone
    start = jax.tree.map(lambda x: jnp.zeros_like(x, dtype=row.dtype), first)
    found, _ = lax.scan(step, start, (jnp.arange(steps), slopes))
    return jax.tree.map(lambda x: jnp.sum(x, axis=1), found)
