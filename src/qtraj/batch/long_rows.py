"""Reductions over very many instants of a path, without their derivatives.

Every lane follows a stretch of the instants and keeps its peak or its sum so far: elementwise work, which compilers for
CPUs vectorise, where they reduce a block to one number sample by sample. When a peak is attained is asked afterwards,
of the one lane that holds it.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from qtraj.batch.blocks import Work
from qtraj.batch.reduction import attained

LANES = 8192
"""Samples side by side: what they need lies in the cache of one core."""

WINDOW = 16
"""Samples of every lane that are fetched together, two lines of the cache."""

LONG = 2**18
"""Instants from which on a row is long: at least two thirds of them fill the lanes."""


def long_row(work: Work, reduction: str, path: Any, columns: tuple[Array, Array], blocks: Work) -> Any:
    """The parts of one path, as `reduction.joiner` gives them, from `columns`: times and weights (1, instants).

    What does not fill the lanes goes through `blocks`: (path, columns) → parts.
    """
    instants = columns[0].shape[1]
    fits = instants - instants % (LANES * WINDOW)
    summed = reduction in ("integral", "mean")
    # Of peaks no weights are asked: in a loop the same column twice would be copied.
    grid = tuple(x[0, :fits].reshape(LANES, -1) for x in columns[: 2 if summed else 1])
    rest = None
    if fits < instants:
        rest = blocks(path, jax.tree.map(lambda x: x[:, fits:], columns))
    if summed:
        lanes = _swept(work, path, grid, 0.0, lambda so_far, x, weight: so_far + x * weight)
        whole = jax.tree.map(lambda x: (jnp.sum(x, axis=1),), lanes)
        return whole if rest is None else jax.tree.map(jnp.add, whole, rest)
    sign = -1 if reduction == "min" else 1
    lanes = _swept(work, path, grid, -jnp.inf, lambda so_far, x, weight: jnp.maximum(so_far, sign * x))
    return _with_times(work, sign, path, grid[0], lanes, rest)


def _swept(work: Work, path: Any, grid: tuple[Array, ...], start: float, take: Callable) -> Any:
    """What every lane (1, LANES) has gathered from `start` on by `take`, over the columns of the grid.

    The grid is that of the times, and of the weights where `take` asks for them.
    """

    def samples(cut: tuple[Array, ...]) -> Any:
        return work(path, (cut[0], cut[-1]))

    def window(i: Array, lanes: Any) -> Any:
        cut = jax.tree.map(lambda x: lax.dynamic_slice_in_dim(x, i * WINDOW, WINDOW, axis=1).T, grid)

        def step(k: Array, lanes: Any) -> Any:
            now = jax.tree.map(lambda x: lax.dynamic_slice_in_dim(x, k, 1), cut)
            return jax.tree.map(lambda so_far, x: take(so_far, x, now[-1]), lanes, samples(now))

        return lax.fori_loop(0, WINDOW, step, lanes)

    kinds = jax.eval_shape(samples, jax.tree.map(lambda x: x[:, :1].T, grid))
    lanes = jax.tree.map(lambda x: jnp.full(x.shape, start, x.dtype), kinds)
    return lax.fori_loop(0, grid[0].shape[1] // WINDOW, window, lanes)


def _with_times(work: Work, sign: int, path: Any, times: Array, lanes: Any, rest: Any) -> Any:
    """(peak, when) of every component from the peaks of the lanes, times `sign`, and the parts of the rest."""
    leaves, form = jax.tree.flatten(lanes)
    peaks = jnp.concatenate(leaves)
    highest = jnp.max(peaks, axis=1)
    tail = None
    if rest is not None:
        parts = form.flatten_up_to(rest)
        tail = jnp.stack([sign * part[0][0] for part in parts]), jnp.stack([part[1][0] for part in parts])
        highest = jnp.maximum(highest, tail[0])
    earliest = jnp.min(times, axis=1)[None]
    held = attained(peaks, highest[:, None])
    holder = jnp.argmin(jnp.where(held, earliest, jnp.inf), axis=1)

    def when(component: Array, lane: Array, peak: Array, held: Array) -> Array:
        own = times[lane][None]
        samples = sign * jnp.stack(jax.tree.leaves(work(path, (own, own))))[component]
        # The samples are worked out a second time: should none be what it was to rounding, the largest is the peak.
        near = jnp.min(jnp.where(attained(samples, peak), own, jnp.inf))
        largest = own[0, jnp.argmax(samples)]
        return jnp.where(jnp.isinf(near) & held, largest, near)

    found = lax.map(lambda of: when(*of), (jnp.arange(len(leaves)), holder, highest, jnp.any(held, axis=1)))
    if tail is not None:
        found = jnp.minimum(found, jnp.where(attained(tail[0], highest), tail[1], jnp.inf))
    return form.unflatten([(sign * highest[k, None], found[k, None]) for k in range(len(leaves))])


def by_path(row: Callable[[Any, Any], Any], paths: Any, columns: Any, count: int) -> Any:
    """What `row` gives for each path, (paths,), one after the other; times are shared, or each path has its own."""
    if count == 1:
        return row(paths, columns)
    one = lambda k, x: lax.dynamic_slice_in_dim(x, k if x.shape[0] > 1 else 0, 1)  # noqa: E731

    def each(k: Array) -> Any:
        return row(*(jax.tree.map(lambda x: one(k, x), tree) for tree in (paths, columns)))

    return jax.tree.map(lambda x: x[:, 0], lax.map(each, jnp.arange(count)))
