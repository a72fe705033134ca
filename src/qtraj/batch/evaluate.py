"""Many instants of many paths in one call."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from qtraj.batch.minimizing import HUNG, hung
from qtraj.batch.program import run
from qtraj.batch.reduction import REDUCTIONS, Reduced
from qtraj.batch.table import Table
from qtraj.batch.task import Task
from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import ArrayInput
from qtraj.motion.programs.rotation_minimizing import Frame, RotationMinimizing, require_initial
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import MINIMIZING
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.rate_axes import BODY, require_axes
from qtraj.path.trihedral import AbstractFrame, Natural

DEFAULT_OUTPUTS = ("position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate")


def evaluate(
    paths: AbstractHodograph,
    times: ArrayInput,
    outputs: Sequence[str] = DEFAULT_OUTPUTS,
    frame: Frame | None = None,
    components: str = "last",
    continuous: bool = False,
    reduce: str | None = None,
    devices: Sequence[Any] | None = None,
    reuse: Table | None = None,
    axes: str = BODY,
) -> Any:
    """Evaluate one path, or a stack of paths as `jax.vmap` makes it, at `times` [s], shared (n,) or per path (b, n).

    One path gives a `Table` of arrays (n, …), b paths (b, n, …); with `components="first"` the components' axes lead.
    Each component lies contiguously in memory, except those of a rotation-minimizing frame. `outputs` are names of
    `Table`: vectors, frames, and every path quantity. `frame` is the trihedral to hang on the path: `Natural()` (the
    default), `Upright()`, `ThrustAligned()`, or `RotationMinimizing()`. Labels of `to_xarray()` follow it: tangent,
    normal, binormal, or forward, left, up. A quaternion's sign is free at each instant; `continuous=True` chooses it so
    that neighbours in time agree.

    `axes` are those of `rate` and `angular_acceleration`: "body", the frame's own, or "inertial", the world's.

    `reduce` "max", "min", "integral" (trapezoidal rule) or "mean" gives a `Reduced` over the instants instead, and no
    sample is stored. `devices` to spread the work over are all local ones, if there is enough to do. `reuse` is the
    table of an earlier call of the same form: its arrays are written over and must not be used again, which spares
    the system from finding fresh memory.

    Paths that have `polynomials`, with a natural or upright frame, are fastest. The call may be traced, and
    differentiated in both modes.

    **Raises:** ValueError for something else than a path, unknown outputs, components, axes, reductions, times that are
    neither (n,) nor (b, n), a table to reuse that is not of this form, or a rotation-minimizing frame with `reduce`
    or `reuse`.
    """
    require_axes(axes)
    task = Task(
        names=_names(outputs),
        components=_one_of(components, ("last", "first"), "components"),
        batched=_batched(paths),
        continuous=continuous,
        reduce=None if reduce is None else _one_of(reduce, REDUCTIONS, "reduce"),
        axes=axes,
    )
    if frame is not None and not isinstance(frame, AbstractFrame | RotationMinimizing):
        raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
    instants = as_float(times)
    count = paths.duration.shape[0] if task.batched else 1
    rows = (count,) if task.batched else ()
    if instants.ndim == 0 or (instants.ndim > 1 and instants.shape[:-1] != rows):
        expected = f"(n,) or ({count}, n)" if task.batched else "(n,)"
        raise ValueError(f"times must be a vector {expected}, but an array of shape {instants.shape} was given")
    if instants.shape[-1] == 0:
        raise ValueError("times must hold at least one instant")
    if isinstance(frame, RotationMinimizing):
        return _minimizing(task, paths, frame, instants, reuse, devices)
    frame = Natural() if frame is None else frame
    work = (paths, frame)
    traced = any(isinstance(x, Tracer) for x in (*jax.tree.leaves(work), instants))
    values = run(
        task, work, instants, None if traced else devices, traced, _old(reuse, task, (*rows, instants.shape[-1]))
    )
    form: Any = {"batched": task.batched, "components": components, "frame": frame.name, "axes": axes}
    if task.reduce is not None:
        return Reduced(*values, reduction=task.reduce, **form)
    return Table(time=instants, **values, **form)


def _minimizing(
    task: Task,
    paths: AbstractHodograph,
    frame: RotationMinimizing,
    instants: Any,
    reuse: Table | None,
    devices: Sequence[Any] | None,
) -> Table:
    """The table with a rotation-minimizing frame: its attitude is followed along each path."""
    if task.reduce is not None or reuse is not None:
        raise ValueError(
            "a rotation-minimizing frame is followed along the path, so it suits neither reduce nor reuse: evaluate it "
            "without them and reduce the arrays"
        )
    if not task.batched:
        require_initial(paths, frame.initial)
    names = tuple(name for name in task.names if name not in HUNG)
    plain = evaluate(paths, instants, names, components=task.components, devices=devices).values if names else {}
    values = plain | hung(task, paths, frame, instants)
    ordered = {name: values[name] for name in task.names}
    form: Any = {"batched": task.batched, "components": task.components, "frame": MINIMIZING, "axes": task.axes}
    return Table(time=instants, **ordered, **form)


def _names(outputs: Sequence[str]) -> tuple[str, ...]:
    if isinstance(outputs, str):
        raise ValueError(
            f"outputs must be a sequence of names, such as ({outputs!r},), but the text {outputs!r} was given"
        )
    names = tuple(dict.fromkeys(outputs))
    if unknown := [name for name in names if name not in CHANNELS]:
        raise ValueError(f"unknown output {unknown[0]!r}; known are {', '.join(CHANNELS)}")
    return names


def _batched(paths: AbstractHodograph) -> bool:
    if not isinstance(paths, AbstractHodograph):
        raise ValueError(
            f"a path, or many of them stacked into one, was expected, but a {type(paths).__name__} was given. "
            "Stack equal structures with jax.tree.map(lambda *x: jnp.stack(x), *paths), or build them under jax.vmap."
        )
    return jnp.ndim(paths.duration) == 1


def _one_of(value: str, known: tuple[str, ...], name: str) -> str:
    if value not in known:
        listed = ", ".join(repr(k) for k in known[:-1]) + f" or {known[-1]!r}"
        raise ValueError(f"{name} must be {listed}, but {value!r} was given")
    return value


def _old(reuse: Table | None, task: Task, lead: tuple[int, ...]) -> dict[str, Any] | None:
    if reuse is None:
        return None
    arrays: dict[str, Any] = {name: getattr(reuse, name, None) for name in task.names}
    form = (reuse.batched, reuse.components, reuse.axes) if isinstance(reuse, Table) else None
    if (
        form != (task.batched, task.components, task.axes)
        or any(x is None for x in arrays.values())
        or task.reduce is not None
    ):
        raise ValueError("reuse must be the table of an earlier call with the same outputs, components and paths")
    shape = np.shape(next(iter(arrays.values())))
    known = shape[: len(lead)] if task.components == "last" else shape[-len(lead) :]
    if known != lead:
        raise ValueError(
            f"reuse must be a table of as many paths and instants, here {lead}, but one of {known} was given"
        )
    return arrays
