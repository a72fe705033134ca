"""The compiled programs behind `evaluate`."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.experimental.layout import Format
from jax.sharding import PartitionSpec, SingleDeviceSharding
from jaxtyping import Array

from qtraj.batch.blocks import SAMPLES, filled, mapped, reduced
from qtraj.batch.channels import channels
from qtraj.batch.cpu import in_one_loop
from qtraj.batch.devices import AXIS, Spread, spread
from qtraj.batch.long_rows import LONG, by_path, long_row
from qtraj.batch.reduction import LINEAR, block_peak, joiner
from qtraj.batch.sums import integrals, neighbours
from qtraj.batch.task import Task
from qtraj.foundation.derivatives import carrying
from qtraj.path.channel import CHANNELS


def run(
    task: Task, work: Any, times: Array, devices: Sequence[Any] | None, traced: bool, old: dict[str, Array] | None
) -> Any:
    """Results by name, or values and times of a reduction, of `work`: a path or stack, and a frame.

    `times` (instants,) or (paths, instants) get their leading axis where that copies nothing: in compiled code.
    """
    if traced:
        return _traced(task, work, jnp.atleast_2d(times))
    dynamic, static = eqx.partition(work, eqx.is_array)
    count = work[0].duration.shape[0] if task.batched else 1
    over = spread(count, times.shape[-1], devices)
    if task.reduce is not None:
        return _reduction(task, over)(static, dynamic, times)
    return _writing(task, over, old is not None)(static, dynamic, times, old)


def _traced(task: Task, request: Any, times: Array) -> Any:
    """Inside a trace: by sweeps that can be differentiated."""
    paths, frame = _stacked(task, request)
    shape = (paths.duration.shape[0], times.shape[1])
    if task.reduce in ("max", "min"):
        return _finished(task, _followed(task, paths, frame, times), times)
    if task.reduce == "mean" and times.shape[1] == 1:
        return _finished(task, _of_one_instant(task, paths, frame, times), times)
    if task.reduce is not None:
        return _finished(task, _summed(task, paths, frame, times, neighbours(times)), times)
    arrays, work = _worker(paths, frame, task.names)
    values = mapped(work, arrays, (times,), shape, _samples())
    flat = {name: jnp.stack(values[name]) for name in task.names}
    lead = shape if task.batched else shape[1:]
    return _results(task, {name: x.reshape(*CHANNELS[name].shape, *lead) for name, x in flat.items()})


def _followed(task: Task, paths: Any, frame: Any, times: Array) -> Any:
    """Peaks whose derivatives are those at the instants where they are attained (envelope theorem).

    The search itself is not differentiated, which spares the reverse pass over all samples. Where several instants
    hold the peak to rounding, the derivatives are those at the first of them. A peak that is not finite has none.
    """
    found = _frozen(_peaks(task, _frozen(paths), _frozen(frame), _frozen(times)))
    first = jnp.stack([when for name in task.names for _, when in found[name]], axis=1)
    instants = _with_place(jnp.where(jnp.isfinite(first), first, _frozen(times[:, :1])), times)
    arrays, work = _worker(paths, frame, task.names)
    there = work(arrays, (instants,))
    column = iter(range(instants.shape[1]))

    def peak(samples: Array, part: tuple[Array, Array]) -> tuple[Array, Array]:
        (value, when), k = part, next(column)
        x, known = samples[:, k].astype(value.dtype), jnp.isfinite(when)
        finite = known & jnp.isfinite(value) & jnp.isfinite(x)
        return jnp.where(finite, x, value), jnp.where(known, instants[:, k], when)

    return {name: tuple(peak(x, part) for x, part in zip(there[name], found[name], strict=True)) for name in task.names}


def _with_place(instants: Array, times: Array) -> Array:
    """Instants (paths, peaks), each with the derivatives of the nearest of its path's `times` (paths or 1, instants).

    Where it is asks for a search, of which nothing is left if the times have no derivatives.
    """
    fixed = _frozen(times)
    rows = jnp.broadcast_to(jnp.arange(instants.shape[0])[:, None] % times.shape[0], instants.shape)
    near = lambda of: jnp.argmin(jnp.abs(fixed[of[0]] - of[1]))  # noqa: E731
    at_once = max(1, _samples() // times.shape[1])
    place = jax.lax.map(near, (rows.ravel(), instants.ravel()), batch_size=at_once).reshape(instants.shape)
    return carrying(instants, times[rows, place])


def _frozen(tree: Any) -> Any:
    """The tree without derivatives."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, tree)


@lru_cache(maxsize=128)
def _writing(task: Task, over: Spread | None, donate: bool) -> Any:
    """A compiled call that writes every block into its results.

    Of an old table nothing is asked but its memory, which the results then have.
    """

    def call(static: Any, dynamic: Any, times: Array, old: Any) -> Any:
        times = jnp.atleast_2d(times)
        paths, frame = _stacked(task, eqx.combine(dynamic, static))

        def local(paths: Any, times: Array) -> Any:
            count, instants = paths.duration.shape[0], times.shape[1]
            arrays, work = _worker(paths, frame, task.names)

            def empty(name: str, dtype: Any) -> Array:
                # Values that differ: of equal ones the compiler would make one buffer, and then copy it.
                return jnp.full(task.raw_shape(name, count, instants), task.names.index(name), dtype)

            return filled(work, empty, task.write, arrays, (times,), (count, instants), _samples())

        if over is not None:
            out = {name: task.spec(name, over.lead, "first") for name in task.names}
            specs = (over.paths, over.columns(times.shape[0]))
            local = jax.shard_map(local, mesh=over.mesh, in_specs=specs, out_specs=out, check_vma=False)
        return _results(task, local(paths, times))

    formats = {name: Format(task.layout(name), _sharding(task, name, over)) for name in task.names}
    donated: dict[str, Any] = {"donate_argnums": (3,), "keep_unused": True} if donate else {}
    inputs = (None, None, formats if donate else None)
    return jax.jit(call, static_argnums=0, in_shardings=inputs, out_shardings=formats, **donated)


@lru_cache(maxsize=128)
def _reduction(task: Task, over: Spread | None) -> Any:
    """A compiled call that reduces every block."""

    def call(static: Any, dynamic: Any, times: Array) -> Any:
        times = jnp.atleast_2d(times)
        paths, frame = _stacked(task, eqx.combine(dynamic, static))

        def local(paths: Any, times: Array, around: Array) -> Any:
            if task.reduce in LINEAR:
                return _summed(task, paths, frame, times, around)
            return _peaks(task, paths, frame, times)

        if task.reduce == "mean" and times.shape[1] == 1:
            return _finished(task, _of_one_instant(task, paths, frame, times), times)
        if over is None:
            return _finished(task, local(paths, times, neighbours(times)), times)
        by_time = over.over == "instants"
        around = neighbours(times, over.mesh.size if by_time else 1)
        columns = over.columns(times.shape[0])
        parts = jax.shard_map(
            lambda *given: jax.tree.map(lambda x: x[None] if by_time else x, local(*given)),
            mesh=over.mesh,
            in_specs=(over.paths, columns, columns),
            out_specs=PartitionSpec(AXIS),
            check_vma=False,
        )(paths, times, around)
        return _finished(task, _joined(task, parts) if by_time else parts, times)

    return jax.jit(call, static_argnums=0)


def _summed(task: Task, paths: Any, frame: Any, times: Array, around: Array) -> Any:
    """For each name and component its integral, (paths,), over times that may be a piece of longer rows."""
    arrays, work = _worker(paths, frame, task.names)
    return jax.tree.map(lambda x: (x,), integrals(work, arrays, times, around, _samples()))


def _of_one_instant(task: Task, paths: Any, frame: Any, times: Array) -> Any:
    """For each name and component its value, (paths,): the mean of one instant."""
    arrays, work = _worker(paths, frame, task.names)
    return jax.tree.map(lambda x: (x[:, 0].astype(times.dtype),), work(arrays, (times,)))


def _peaks(task: Task, paths: Any, frame: Any, times: Array) -> Any:
    """For each name and component (peak, when), (paths,), without derivatives."""
    arrays, evaluated = _worker(paths, frame, task.names)
    shape, reduction = (paths.duration.shape[0], times.shape[1]), str(task.reduce)
    peak = block_peak(reduction)

    def samples(path: Any, cut: Any) -> Any:
        return jax.tree.map(lambda x: x.astype(times.dtype), evaluated(path, cut))

    def work(path: Any, cut: Any) -> Any:
        return jax.tree.map(lambda x: peak(x, *cut), samples(path, cut))

    def join(parts: Any) -> Any:
        return _joined(task, parts)

    if shape[1] >= _long():
        rest = lambda path, tail: reduced(work, join, path, tail, (1, tail[0].shape[1]), _samples())  # noqa: E731
        row = lambda path, cut: long_row(samples, reduction, path, cut, rest)  # noqa: E731
        return by_path(row, arrays, (times,), shape[0])
    return reduced(work, join, arrays, (times,), shape, _samples())


def _joined(task: Task, parts: Any) -> Any:
    join = joiner(str(task.reduce))
    return {name: tuple(join(component) for component in parts[name]) for name in task.names}


def _finished(task: Task, parts: Any, times: Array) -> Any:
    """Values by name, and times of peaks, from the parts of whole rows of `times`."""
    span = times[:, -1] - times[:, 0] if task.reduce == "mean" and times.shape[1] > 1 else 1
    values = {name: task.shaped(name, jnp.stack([c[0] / span for c in parts[name]])) for name in task.names}
    if task.reduce in LINEAR:
        return values, None
    return values, {name: task.shaped(name, jnp.stack([c[1] for c in parts[name]])) for name in task.names}


def _stacked(task: Task, work: Any) -> Any:
    """The paths with a leading axis, and the frame with the axes of its rates."""
    paths, frame = work
    lead = lambda x: jnp.asarray(x)[None] if eqx.is_array_like(x) else x  # noqa: E731
    return (paths if task.batched else jax.tree.map(lead, paths)), (frame, task.axes)


def _worker(paths: Any, frame: Any, names: tuple[str, ...]) -> Any:
    """The arrays of the paths, and the function that evaluates a block of them at (times, …)."""
    arrays, rest = eqx.partition(paths, eqx.is_array)

    @partial(jax.jit, inline=True)  # traced once for each shape of blocks
    def work(block: Any, cut: Any) -> Any:
        leaves, form = jax.tree.flatten(channels(eqx.combine(block, rest), cut[0], frame, names))
        return form.unflatten(in_one_loop(leaves))

    return arrays, work


def _results(task: Task, raw: dict[str, Array]) -> dict[str, Array]:
    """Results from arrays with their components first."""
    if task.continuous and "quaternion" in raw:
        raw = raw | {"quaternion": _continuous(raw["quaternion"])}
    return {name: task.ordered(name, x) for name, x in raw.items()}


def _continuous(q: Array) -> Array:
    """Quaternions (4, …, instants) with signs such that neighbours agree; as `rotation.continuous`."""
    turned = jnp.sum(q[..., 1:] * q[..., :-1], axis=0) < 0
    flips = jnp.cumsum(turned.astype(jnp.int32), axis=-1)
    flips = jnp.concatenate([jnp.zeros_like(flips, shape=(*flips.shape[:-1], 1)), flips], axis=-1)
    return q * jax.lax.stop_gradient(jnp.where(flips % 2 == 0, 1.0, -1.0).astype(q.dtype))[None]


def _long() -> float:
    """Instants from which on rows are reduced lane by lane; other devices than CPUs reduce a block as fast."""
    return float(LONG) if jax.default_backend() == "cpu" else float("inf")


def _samples() -> int:
    """Instants in a block: caches are a matter of CPUs, other devices take all at once, up to their memory."""
    return SAMPLES if jax.default_backend() == "cpu" else 2**24


def _sharding(task: Task, name: str, over: Spread | None) -> Any:
    if over is None:
        return SingleDeviceSharding(jax.local_devices()[0])
    return over.sharding(task.spec(name, over.lead, task.components))
