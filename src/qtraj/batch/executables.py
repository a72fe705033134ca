"""Create the compiled functions for `qtraj.evaluate`."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.experimental.layout import Format
from jax.sharding import PartitionSpec
from jaxtyping import Array

from qtraj.algebra.cpu import in_one_loop
from qtraj.batch.blocks import SAMPLES, filled, mapped, reduced
from qtraj.batch.channels import channels
from qtraj.batch.devices import AXIS, Place, placed
from qtraj.batch.fused import accelerator_peaks, fused_formulas, fused_or, is_interpreted
from qtraj.batch.fused_kernel import sums, written
from qtraj.batch.kernel_choice import uses_kernel
from qtraj.batch.long_rows import LONG, by_path, long_row
from qtraj.batch.reduction import LINEAR, block_peak, joiner
from qtraj.batch.stacking import results, stacked
from qtraj.batch.sums import integrals, neighbours
from qtraj.batch.task import Task
from qtraj.foundation.derivatives import with_tangent_of
from qtraj.foundation.devices import default_platform
from qtraj.path.channel import CHANNELS


def run(
    task: Task, work: Any, times: Array, devices: Sequence[Any] | None, traced: bool, old: dict[str, Array] | None
) -> Any:
    """Return the arrays of the outputs by name; for a reduction, return the values and the times, each by name.

    The times are the instants of the peaks, or None for reductions that sum samples.

    `work` consists of a path or a batch of paths, a frame, and a vehicle or None. `times` are (instants,) or (paths,
    instants). The compiled code adds a missing leading axis without a copy.

    **Raises:** ValueError if arrays are on different devices and `devices` is None.
    """
    if traced:
        return _traced(task, work, jnp.atleast_2d(times))
    dynamic, static = eqx.partition(work, eqx.is_array)
    count = work[0].duration.shape[0] if task.batched else 1
    place = placed(count, times.shape[-1], devices, (dynamic, times, old))
    if devices is not None:
        dynamic, times = jax.device_put((dynamic, times), place.sharding())
    if task.reduce is not None:
        return _reduction(task, place)(static, dynamic, times)
    call, formats = _writing(task, place, old is not None)
    return call(static, dynamic, times, None if old is None else {k: _in_format(x, formats[k]) for k, x in old.items()})


def _in_format(x: Any, wanted: Any) -> Any:
    """Return an array in the format of the results; one from a few instants has the usual layout, and is copied."""
    own = x.format
    same = own.layout.major_to_minor == wanted.layout.major_to_minor
    return x if same and own.sharding.is_equivalent_to(wanted.sharding, x.ndim) else jax.device_put(x, wanted)


@eqx.filter_jit  # under grad outside jit, the operations would be compiled one by one
def _traced(task: Task, request: Any, times: Array) -> Any:
    """Return the results inside a trace, with derivatives."""
    paths, frame = stacked(task, request)
    shape = (paths.duration.shape[0], times.shape[1])
    if task.reduce in ("max", "min"):
        return _finished(task, _differentiable_peaks(task, paths, frame, times), times)
    if task.reduce == "mean" and times.shape[1] == 1:
        return _finished(task, _single_instant(task, paths, frame, times), times)
    if task.reduce is not None:
        return _finished(task, _summed(task, paths, frame, times, neighbours(times), default_platform()), times)
    flat = _values(task, paths, frame, times)
    lead = shape if task.batched else shape[1:]
    return results(task, {name: x.reshape(*CHANNELS[name].shape, *lead) for name, x in flat.items()})


def _values(task: Task, paths: Any, frame: Any, times: Array) -> dict[str, Array]:
    """Return the outputs (components, paths, instants) by name, inside a trace, with derivatives."""
    platform = default_platform()

    def plain(paths: Any, frame: Any, times: Array) -> dict[str, Array]:
        arrays, work = _worker(paths, frame, task.names)
        shape = (paths.duration.shape[0], times.shape[1])
        values = mapped(work, arrays, (times,), shape, _samples(platform))
        return {name: jnp.stack(values[name]) for name in task.names}

    return fused_or(plain, written, _worker, task, platform)(paths, frame, times)


def _differentiable_peaks(task: Task, paths: Any, frame: Any, times: Array) -> Any:
    """Return the peaks, with derivatives at the instants of the peaks only (envelope theorem).

    The search is not differentiated, so no reverse pass over all samples is needed. If several samples equal the peak
    to within rounding, the derivatives are evaluated at the first of their instants. The derivatives of a peak that is
    not finite are zero.
    """
    fixed = [_stop_gradient(x) for x in (paths, frame, times)]
    peaks = _stop_gradient(_peaks(task, fixed[0], fixed[1], fixed[2], default_platform()))
    first = jnp.stack([when for name in task.names for _, when in peaks[name]], axis=1)
    instants = _with_time_derivatives(jnp.where(jnp.isfinite(first), first, _stop_gradient(times[:, :1])), times)
    arrays, work = _worker(paths, frame, task.names)
    at_peaks = work(arrays, (instants,))
    column = iter(range(instants.shape[1]))

    def peak(samples: Array, part: tuple[Array, Array]) -> tuple[Array, Array]:
        (value, when), k = part, next(column)
        x, attained = samples[:, k].astype(value.dtype), jnp.isfinite(when)
        finite = attained & jnp.isfinite(value) & jnp.isfinite(x)
        return jnp.where(finite, x, value), jnp.where(attained, instants[:, k], when)

    return {
        name: tuple(peak(x, part) for x, part in zip(at_peaks[name], peaks[name], strict=True)) for name in task.names
    }


def _with_time_derivatives(instants: Array, times: Array) -> Array:
    """Return `instants` (paths, peaks) with the derivatives of the nearest elements of `times` (paths or 1, instants).

    If the times have no derivatives, the compiler removes the search for the nearest time.
    """
    fixed = _stop_gradient(times)
    rows = jnp.broadcast_to(jnp.arange(instants.shape[0])[:, None] % times.shape[0], instants.shape)
    nearest = lambda row_and_time: jnp.argmin(jnp.abs(fixed[row_and_time[0]] - row_and_time[1]))  # noqa: E731
    batch_size = max(1, _samples(default_platform()) // times.shape[1])
    index = jax.lax.map(nearest, (rows.ravel(), instants.ravel()), batch_size=batch_size).reshape(instants.shape)
    return with_tangent_of(instants, times[rows, index])


def _stop_gradient(tree: Any) -> Any:
    """Return a tree with the same values; its arrays are treated as constants in differentiation."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, tree)


@lru_cache(maxsize=128)
def _writing(task: Task, place: Place, donate: bool) -> Any:
    """Return a compiled function that evaluates block by block and writes each block into the arrays of the results.

    The second result are the formats of these arrays by name.

    If the arrays of an old table are donated, the function uses their memory for the results and ignores their values.
    """

    def call(static: Any, dynamic: Any, times: Array, old: Any) -> Any:
        times = jnp.atleast_2d(times)
        paths, frame = stacked(task, eqx.combine(dynamic, static))

        def local(paths: Any, times: Array) -> Any:
            count, instants = paths.duration.shape[0], times.shape[1]
            arrays, work = _worker(paths, frame, task.names)
            formulas = fused_formulas(task, place.platform, work, arrays, times)
            if formulas is not None:
                found = written(formulas, arrays, times, is_interpreted(task))
                return {name: x.reshape(task.raw_shape(name, count, instants)) for name, x in found.items()}

            def empty(name: str, dtype: Any) -> Array:
                # Use different fill values, because the compiler would merge equal buffers and then copy the result.
                return jnp.full(task.raw_shape(name, count, instants), task.names.index(name), dtype)

            return filled(work, empty, task.write, arrays, (times,), (count, instants), _samples(place.platform))

        if place.over is not None:
            out = {name: task.spec(name, place.lead, "first") for name in task.names}
            specs = (place.paths, place.columns(times.shape[0]))
            local = jax.shard_map(local, mesh=place.mesh, in_specs=specs, out_specs=out, check_vma=False)
        return results(task, local(paths, times))

    sharding = {name: place.sharding(task.spec(name, place.lead, task.components)) for name in task.names}
    formats = {name: Format(task.layout(name), sharding[name]) for name in task.names}
    donated: dict[str, Any] = {"donate_argnums": (3,), "keep_unused": True} if donate else {}
    inputs = (None, None, formats if donate else None)
    return jax.jit(call, static_argnums=0, in_shardings=inputs, out_shardings=formats, **donated), formats


@lru_cache(maxsize=128)
def _reduction(task: Task, place: Place) -> Any:
    """Return a compiled function that reduces every block and combines the results of the blocks."""

    def call(static: Any, dynamic: Any, times: Array) -> Any:
        times = jnp.atleast_2d(times)
        paths, frame = stacked(task, eqx.combine(dynamic, static))

        def local(paths: Any, times: Array, around: Array) -> Any:
            if task.reduce in LINEAR:
                return _summed(task, paths, frame, times, around, place.platform)
            return _peaks(task, paths, frame, times, place.platform)

        if task.reduce == "mean" and times.shape[1] == 1:
            return _finished(task, _single_instant(task, paths, frame, times), times)
        if place.over is None:
            return _finished(task, local(paths, times, neighbours(times)), times)
        by_time = place.over == "instants"
        around = neighbours(times, place.mesh.size if by_time else 1)
        columns = place.columns(times.shape[0])
        parts = jax.shard_map(
            lambda *pieces: jax.tree.map(lambda x: x[None] if by_time else x, local(*pieces)),
            mesh=place.mesh,
            in_specs=(place.paths, columns, columns),
            out_specs=PartitionSpec(AXIS),
            check_vma=False,
        )(paths, times, around)
        return _finished(task, _joined(task, parts) if by_time else parts, times)

    return jax.jit(call, static_argnums=0)


def _summed(task: Task, paths: Any, frame: Any, times: Array, around: Array, platform: str) -> Any:
    """Return the integral (paths,) of each component by name; `around` contains the `neighbours` of the times."""

    def plain(paths: Any, frame: Any, times: Array, around: Array) -> Any:
        arrays, work = _worker(paths, frame, task.names)
        return jax.tree.map(lambda x: (x,), integrals(work, arrays, times, around, _samples(platform)))

    return fused_or(plain, sums, _worker, task, platform)(paths, frame, times, around)


def _single_instant(task: Task, paths: Any, frame: Any, times: Array) -> Any:
    """Return the value (paths,) of each component by name; with one instant, it is also the mean."""
    arrays, work = _worker(paths, frame, task.names)
    return jax.tree.map(lambda x: (x[:, 0].astype(times.dtype),), work(arrays, (times,)))


def _peaks(task: Task, paths: Any, frame: Any, times: Array, platform: str) -> Any:
    """Return (peak, time), each (paths,), for each component by name, without derivatives."""
    arrays, evaluated = _worker(paths, frame, task.names)
    shape, reduction = (paths.duration.shape[0], times.shape[1]), str(task.reduce)
    if platform != "cpu" or uses_kernel(task.kernel, platform):
        return accelerator_peaks(task, platform, evaluated, arrays, times, _samples(platform))
    peak = block_peak(reduction)

    def samples(path: Any, cut: Any) -> Any:
        return jax.tree.map(lambda x: x.astype(times.dtype), evaluated(path, cut))

    def work(path: Any, cut: Any) -> Any:
        return jax.tree.map(lambda x: peak(x, *cut), samples(path, cut))

    def join(parts: Any) -> Any:
        return _joined(task, parts)

    if shape[1] >= LONG:
        rest = lambda path, tail: reduced(work, join, path, tail, (1, tail[0].shape[1]))  # noqa: E731
        row = lambda path, cut: long_row(samples, reduction, path, cut, rest)  # noqa: E731
        return by_path(row, arrays, (times,), shape[0])
    return reduced(work, join, arrays, (times,), shape)


def _joined(task: Task, parts: Any) -> Any:
    join = joiner(str(task.reduce))
    return {name: tuple(join(component) for component in parts[name]) for name in task.names}


def _finished(task: Task, parts: Any, times: Array) -> Any:
    """Return the values by name, and the times of peaks or None, from the reductions over the rows of `times`."""
    span = times[:, -1] - times[:, 0] if task.reduce == "mean" and times.shape[1] > 1 else 1
    values = {name: task.shaped(name, jnp.stack([c[0] / span for c in parts[name]])) for name in task.names}
    if task.reduce in LINEAR:
        return values, None
    return values, {name: task.shaped(name, jnp.stack([c[1] for c in parts[name]])) for name in task.names}


def _worker(paths: Any, frame: Any, names: tuple[str, ...]) -> Any:
    """Return the arrays of the paths, and a function that evaluates the outputs of a block of paths."""
    arrays, rest = eqx.partition(paths, eqx.is_array)

    @partial(jax.jit, inline=True)  # traced once for each block shape
    def work(block: Any, cut: Any) -> Any:
        driven = eqx.combine(block, rest)
        about = frame if driven.vehicle is None else (*frame[:2], driven.vehicle)
        leaves, structure = jax.tree.flatten(channels(driven.paths, cut[0], about, names))
        return structure.unflatten(in_one_loop(leaves))

    return arrays, work


def _samples(platform: str) -> int:
    """Return the maximum size of a block, which is limited by the caches of a CPU or by the memory of other devices."""
    return SAMPLES if platform == "cpu" else 2**24
