"""The compiled programs behind `evaluate`."""

import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.layout import Format
from jax.sharding import PartitionSpec, SingleDeviceSharding
from jaxtyping import Array

from qtraj.batch.blocks import SAMPLES, filled, mapped, reduced
from qtraj.batch.channels import channels
from qtraj.batch.devices import AXIS, Spread, spread
from qtraj.batch.long_rows import LONG, by_path, long_row
from qtraj.batch.reduction import block_reducer, joiner, weights
from qtraj.batch.task import Task, inner_shape


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
    one = np.ones((), times.dtype)
    if task.reduce is not None:
        return _reduction(task, over)(static, dynamic, times, one)
    return _writing(task, over, old is not None)(static, dynamic, times, one, old)


def _traced(task: Task, request: Any, times: Array) -> Any:
    """Inside a trace: by sweeps that can be differentiated."""
    paths, frame = _stacked(task, request)
    shape = (paths.duration.shape[0], times.shape[1])
    # 1 whatever the data are, NaN among them, which no compiler finds out before it has stored what it divides by it.
    bit = (paths.duration[0] > 0).astype(times.dtype)
    one = bit * bit - bit + 1
    if task.reduce in ("max", "min"):
        return _finished(task, _followed(task, paths, frame, times, one))
    if task.reduce is not None:
        return _finished(task, _reduced(task, paths, frame, times, one))
    arrays, work = _worker(paths, frame, task.names, one)
    values = mapped(work, arrays, (times,), shape, _samples())
    flat = {name: jnp.stack(values[name]) for name in task.names}
    lead = shape if task.batched else shape[1:]
    return _results(task, {name: x.reshape(*inner_shape(name), *lead) for name, x in flat.items()})


def _followed(task: Task, paths: Any, frame: Any, times: Array, one: Any) -> Any:
    """Peaks whose derivatives are those at the instants where they are attained (envelope theorem).

    The search itself is not differentiated, which spares the reverse pass over all samples. Where several instants
    hold the peak to rounding, the derivatives are those at the first of them. A peak that is not finite has none.
    """
    found = _frozen(_reduced(task, _frozen(paths), _frozen(frame), _frozen(times), one))
    first = jnp.stack([when for name in task.names for _, when in found[name]], axis=1)
    place = _nearest(_frozen(times), first)
    instants = times[0][place] if times.shape[0] == 1 else jnp.take_along_axis(times, place, axis=1)
    arrays, work = _worker(paths, frame, task.names, one)
    there = work(arrays, (instants,))
    column = iter(range(instants.shape[1]))

    def peak(samples: Array, part: tuple[Array, Array]) -> tuple[Array, Array]:
        (value, when), k = part, next(column)
        x, known = samples[:, k].astype(value.dtype), jnp.isfinite(when)
        finite = known & jnp.isfinite(value) & jnp.isfinite(x)
        return jnp.where(finite, x, value), jnp.where(known, instants[:, k], when)

    return {name: tuple(peak(x, part) for x, part in zip(there[name], found[name], strict=True)) for name in task.names}


def _nearest(times: Array, whens: Array) -> Array:
    """For each of `whens` (paths, peaks) the index of the nearest of its path's `times` (paths or 1, instants)."""
    rows = jnp.broadcast_to(jnp.arange(whens.shape[0])[:, None] % times.shape[0], whens.shape)
    near = lambda of: jnp.argmin(jnp.abs(times[of[0]] - of[1]))  # noqa: E731
    at_once = max(1, _samples() // times.shape[1])
    return jax.lax.map(near, (rows.ravel(), whens.ravel()), batch_size=at_once).reshape(whens.shape)


def _frozen(tree: Any) -> Any:
    """The tree without derivatives."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, tree)


@functools.lru_cache(maxsize=128)
def _writing(task: Task, over: Spread | None, donate: bool) -> Any:
    """A compiled call that writes every block into its results."""

    def call(static: Any, dynamic: Any, times: Array, one: Array, old: Any) -> Any:
        times = jnp.atleast_2d(times)
        paths, frame = _stacked(task, eqx.combine(dynamic, static))

        def local(paths: Any, times: Array, one: Array, old: Any) -> Any:
            count, instants = paths.duration.shape[0], times.shape[1]
            arrays, work = _worker(paths, frame, task.names, one)
            kinds = jax.eval_shape(work, arrays, (times,))
            # Values that differ, lest the compiler takes one buffer for several and then copies it.
            buffers = old or {
                name: jnp.full(task.raw_shape(name, count, instants), i, kinds[name][0].dtype)
                for i, name in enumerate(task.names)
            }
            return filled(work, task.write, arrays, (times,), (count, instants), buffers, _samples())

        raw = None if old is None else {name: task.raw(name, x) for name, x in old.items()}
        if over is not None:
            out = {name: task.spec(name, over.lead, "first") for name in task.names}
            specs = (over.paths, over.columns(times.shape[0]), PartitionSpec(), None if raw is None else out)
            local = jax.shard_map(local, mesh=over.mesh, in_specs=specs, out_specs=out, check_vma=False)
        return _results(task, local(paths, times, one, raw))

    formats = {name: Format(task.layout(name), _sharding(task, name, over)) for name in task.names}
    inputs = (None, None, None, formats if donate else None)
    return jax.jit(
        call, static_argnums=0, in_shardings=inputs, out_shardings=formats, donate_argnums=(4,) if donate else ()
    )


@functools.lru_cache(maxsize=128)
def _reduction(task: Task, over: Spread | None) -> Any:
    """A compiled call that reduces every block."""

    def call(static: Any, dynamic: Any, times: Array, one: Array) -> Any:
        times = jnp.atleast_2d(times)
        paths, frame = _stacked(task, eqx.combine(dynamic, static))
        if over is None:
            return _finished(task, _reduced(task, paths, frame, times, one, long=True))
        heavy = weights(times, task.reduce) if task.reduce in ("integral", "mean") else times
        by_time = over.over == "instants"

        def local(paths: Any, times: Array, heavy: Array, one: Array) -> Any:
            parts = _reduced(task, paths, frame, times, one, heavy, long=True)
            return jax.tree.map(lambda x: x[None] if by_time else x, parts)

        columns = over.columns(times.shape[0])
        parts = jax.shard_map(
            local,
            mesh=over.mesh,
            in_specs=(over.paths, columns, columns, PartitionSpec()),
            out_specs=PartitionSpec(AXIS),
            check_vma=False,
        )(paths, times, heavy, one)
        if by_time:
            parts = _joined(task, parts)
        return _finished(task, parts)

    return jax.jit(call, static_argnums=0)


def _reduced(
    task: Task, paths: Any, frame: Any, times: Array, one: Any, heavy: Array | None = None, long: bool = False
) -> Any:
    """For each name and component the parts of the reduction, (paths,); `long` rows have no derivatives."""
    if heavy is None:
        heavy = weights(times, task.reduce) if task.reduce in ("integral", "mean") else times
    arrays, evaluated = _worker(paths, frame, task.names, one)
    shape, reduction = (paths.duration.shape[0], times.shape[1]), str(task.reduce)
    part = block_reducer(reduction)

    def samples(path: Any, cut: Any) -> Any:
        return jax.tree.map(lambda x: x.astype(cut[1].dtype), evaluated(path, cut))

    def work(path: Any, cut: Any) -> Any:
        return jax.tree.map(lambda x: part(x, *cut), samples(path, cut))

    def join(parts: Any) -> Any:
        return _joined(task, parts)

    if long and shape[1] >= _long():
        rest = lambda path, tail: reduced(work, join, path, tail, (1, tail[0].shape[1]), _samples())  # noqa: E731
        row = lambda path, cut: long_row(samples, reduction, path, cut, rest)  # noqa: E731
        return by_path(row, arrays, (times, heavy), shape[0])
    return reduced(work, join, arrays, (times, heavy), shape, _samples())


def _joined(task: Task, parts: Any) -> Any:
    join = joiner(str(task.reduce))
    return {name: tuple(join(component) for component in parts[name]) for name in task.names}


def _finished(task: Task, parts: Any) -> Any:
    values = {name: task.shaped(name, jnp.stack([c[0] for c in parts[name]])) for name in task.names}
    if task.reduce in ("integral", "mean"):
        return values, None
    return values, {name: task.shaped(name, jnp.stack([c[1] for c in parts[name]])) for name in task.names}


def _stacked(task: Task, work: Any) -> Any:
    """The paths with a leading axis, and the frame."""
    paths, frame = work
    lead = lambda x: jnp.asarray(x)[None] if eqx.is_array_like(x) else x  # noqa: E731
    return (paths if task.batched else jax.tree.map(lead, paths)), frame


def _worker(paths: Any, frame: Any, names: tuple[str, ...], one: Any) -> Any:
    """The arrays of the paths, and the function that evaluates a block of them at (times, …)."""
    arrays, rest = eqx.partition(paths, eqx.is_array)
    return arrays, lambda block, cut: channels(eqx.combine(block, rest), cut[0], frame, names, one)


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
