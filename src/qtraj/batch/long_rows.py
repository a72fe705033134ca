"""Peaks over very many instants of a path, without their derivatives.

Every lane follows a stretch of the instants and keeps its peak so far: elementwise work, which compilers for CPUs
vectorise, where they reduce a block to one number sample by sample. When a peak is attained is asked afterwards, of the
one lane that holds it.
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


def long_row(work: Work, reduction: str, path: Any, columns: tuple[Array], blocks: Work) -> Any:
    """The parts of one path, as `reduction.joiner` gives them, from `columns`: its times (1, instants).

    What does not fill the lanes goes through `blocks`: (path, columns) → parts.
    """
    instants = columns[0].shape[1]
    fits = instants - instants % (LANES * WINDOW)
    times = columns[0][0, :fits].reshape(LANES, -1)
    rest = blocks(path, (columns[0][:, fits:],)) if fits < instants else None
    sign = -1 if reduction == "min" else 1
    return _with_times(work, sign, path, times, _lanes(work, sign, path, times), rest)


def _lanes(work: Work, sign: int, path: Any, times: Array) -> Any:
    """The peak of every lane (1, LANES), times `sign`, over the columns of the times (LANES, instants)."""

    def window(i: Array, lanes: Any) -> Any:
        cut = lax.dynamic_slice_in_dim(times, i * WINDOW, WINDOW, axis=1).T

        def step(k: Array, lanes: Any) -> Any:
            now = work(path, (lax.dynamic_slice_in_dim(cut, k, 1),))
            return jax.tree.map(lambda so_far, x: jnp.maximum(so_far, sign * x), lanes, now)

        return lax.fori_loop(0, WINDOW, step, lanes)

    kinds = jax.eval_shape(work, path, (times[:, :1].T,))
    lanes = jax.tree.map(lambda x: jnp.full(x.shape, -jnp.inf, x.dtype), kinds)
    return lax.fori_loop(0, times.shape[1] // WINDOW, window, lanes)


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
        samples = sign * jnp.stack(jax.tree.leaves(work(path, (own,))))[component]
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
