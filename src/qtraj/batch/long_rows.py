"""Find peaks over very many instants of a path, without derivatives.

The instants are divided into segments. The segments are processed together, one sample of each segment at a time, and
each segment has a running peak. These operations are elementwise, so CPU compilers vectorise them. The maximum of a
single row would be computed sample by sample. Afterwards the time of the peak is computed from the segment that
contains the peak.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from qtraj.batch.blocks import Work
from qtraj.batch.reduction import attained

SEGMENTS = 8192
"""Number of segments; one sample of each segment, with the intermediate results, fits into the cache of one core."""

WINDOW = 16
"""Number of successive instants of a segment that are loaded together; in float64 they fill two cache lines."""

LONG = 2**18
"""Minimum number of instants for this method, for which at least two thirds of the instants are in the segments."""


def long_row(work: Work, reduction: str, path: Any, columns: tuple[Array], blocks: Work) -> Any:
    """Return the (peak, time) of every component for one path; `columns` contains the times (1, instants).

    The function `blocks` takes a path and columns. It processes the last instants, which are not in the segments.
    """
    instants = columns[0].shape[1]
    n_full = instants - instants % (SEGMENTS * WINDOW)
    times = columns[0][0, :n_full].reshape(SEGMENTS, -1)
    rest = blocks(path, (columns[0][:, n_full:],)) if n_full < instants else None
    sign = -1 if reduction == "min" else 1
    return _with_times(work, sign, path, times, _segment_peaks(work, sign, path, times), rest)


def _segment_peaks(work: Work, sign: int, path: Any, times: Array) -> Any:
    """Return `sign` times the peak of every segment, (1, SEGMENTS), over the times (SEGMENTS, instants)."""

    def window(i: Array, peaks: Any) -> Any:
        cut = lax.dynamic_slice_in_dim(times, i * WINDOW, WINDOW, axis=1).T

        def step(k: Array, peaks: Any) -> Any:
            values = work(path, (lax.dynamic_slice_in_dim(cut, k, 1),))
            return jax.tree.map(lambda peak, x: jnp.maximum(peak, sign * x), peaks, values)

        return lax.fori_loop(0, WINDOW, step, peaks)

    kinds = jax.eval_shape(work, path, (times[:, :1].T,))
    peaks = jax.tree.map(lambda x: jnp.full(x.shape, -jnp.inf, x.dtype), kinds)
    return lax.fori_loop(0, times.shape[1] // WINDOW, window, peaks)


def _with_times(work: Work, sign: int, path: Any, times: Array, segment_peaks: Any, rest: Any) -> Any:
    """Return (peak, time) of every component from the segments and from `rest`, the peaks of the last instants.

    `segment_peaks` are already multiplied by `sign`. `rest` is None if all instants are in the segments.
    """
    leaves, structure = jax.tree.flatten(segment_peaks)
    peaks = jnp.concatenate(leaves)
    highest = jnp.max(peaks, axis=1)
    tail = None
    if rest is not None:
        parts = structure.flatten_up_to(rest)
        tail = jnp.stack([sign * part[0][0] for part in parts]), jnp.stack([part[1][0] for part in parts])
        highest = jnp.maximum(highest, tail[0])
    earliest = jnp.min(times, axis=1)[None]
    in_segments = attained(peaks, highest[:, None])
    first_segment = jnp.argmin(jnp.where(in_segments, earliest, jnp.inf), axis=1)

    def time_of_peak(component: Array, segment: Array, peak: Array, in_segments: Array) -> Array:
        own_times = times[segment][None]
        samples = sign * jnp.stack(jax.tree.leaves(work(path, (own_times,))))[component]
        # The samples are computed a second time. If no sample equals the peak, because the rounding differs, use the
        # largest sample.
        first = jnp.min(jnp.where(attained(samples, peak), own_times, jnp.inf))
        largest = own_times[0, jnp.argmax(samples)]
        return jnp.where(jnp.isinf(first) & in_segments, largest, first)

    arguments = (jnp.arange(len(leaves)), first_segment, highest, jnp.any(in_segments, axis=1))
    peak_times = lax.map(lambda arguments: time_of_peak(*arguments), arguments)
    if tail is not None:
        peak_times = jnp.minimum(peak_times, jnp.where(attained(tail[0], highest), tail[1], jnp.inf))
    return structure.unflatten([(sign * highest[k, None], peak_times[k, None]) for k in range(len(leaves))])


def by_path(row: Callable[[Any, Any], Any], paths: Any, columns: Any, count: int) -> Any:
    """Apply `row` to each of `count` paths in turn, and return the results (paths,).

    `columns` are arrays with one row for all paths, or one row for each path.
    """
    if count == 1:
        return row(paths, columns)
    one = lambda k, x: lax.dynamic_slice_in_dim(x, k if x.shape[0] > 1 else 0, 1)  # noqa: E731

    def each(k: Array) -> Any:
        return row(*(jax.tree.map(lambda x: one(k, x), tree) for tree in (paths, columns)))

    return jax.tree.map(lambda x: x[:, 0], lax.map(each, jnp.arange(count)))
