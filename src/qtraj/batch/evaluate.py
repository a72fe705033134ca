"""Define `qtraj.evaluate`, which evaluates many paths at many instants in one call."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.batch.at_once import FEW_OF_ONE, evaluated, is_small
from qtraj.batch.devices import ADVICE, as_devices
from qtraj.batch.executables import run
from qtraj.batch.kernel_choice import INTERPRET, kernel_choice
from qtraj.batch.minimizing import FRAME_OUTPUTS, frame_outputs
from qtraj.batch.of_program import OUTPUTS as PROGRAM_OUTPUTS, program_table
from qtraj.batch.reduction import REDUCTIONS, Reduced
from qtraj.batch.table import Table
from qtraj.batch.task import Task
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_seconds, is_traced, require_inside
from qtraj.foundation.devices import device_of
from qtraj.foundation.namespace import is_host
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.programs.rotation_minimizing import Frame, RotationMinimizing, require_initial
from qtraj.path.channel import CHANNELS
from qtraj.path.driving import default_frame, require_one_direction
from qtraj.path.frame_axes import MINIMIZING
from qtraj.path.hodograph import AbstractHodograph, path_advice
from qtraj.path.own_name import name_of
from qtraj.path.own_quantity import Quantity
from qtraj.path.path_quantity import VEHICLE
from qtraj.path.rate_axes import BODY, require_axes
from qtraj.path.trihedral import AbstractFrame
from qtraj.path.vehicle import Vehicle, require, require_vehicle
from qtraj.path.vehicle_data import batch_of, with_batch

DEFAULT_OUTPUTS = ("position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate")


def evaluate(
    paths: AbstractHodograph | AbstractProgram,
    times: ArrayInput,
    outputs: Sequence[str | Quantity] = DEFAULT_OUTPUTS,
    frame: Frame | None = None,
    components: str = "last",
    continuous: bool = False,
    reduce: str | None = None,
    devices: Sequence[Any] | None = None,
    reuse: Table | None = None,
    axes: str = BODY,
    vehicle: Vehicle | None = None,
    extrapolate: bool = False,
) -> Any:
    """Evaluate one path, or a batch of paths created in `jax.vmap`, at `times` [s].

    `times` are (n,), or (b, n) with one row for each of b paths, from 0 at the start of the path. Durations, such as
    `timedelta64`, are converted to seconds; for a recording, pass `track.elapsed`. The result is a `Table` of arrays
    (n, …) for one path, and (b, n, …) for b paths. With `components="first"` the component axes come first. In both
    cases each component is contiguous in memory, except for a rotation-minimizing frame. `outputs` are names of arrays
    in `Table`: vectors, attitudes, and all path quantities; a `Quantity` of one's own is passed itself.

    `frame` is the frame along the path: `Natural()`, `Upright()`, `Driving.along(route)`, `ThrustAligned()` or
    `RotationMinimizing()`. The default is `Driving` for a single concrete route that stops, `Upright()` for any other
    route, and `Natural()` for any other path. The frame determines the labels of `to_xarray()`, such as tangent,
    normal, binormal, or forward, left, up. The first non-zero component of every quaternion is positive. With
    `continuous=True`, and always for a rotation-minimizing frame, the signs are continuous in time instead.

    `axes` are the axes of `rate`, `angular_acceleration`, `force` and `moment`: "body" for the frame's own axes, or
    "inertial" for world axes.

    `vehicle` is required for the outputs `force`, `longitudinal_force`, `lateral_force`, `normal_load`, `friction` and
    `power`. A vehicle with an inertia is required for `moment`; for `tangential_moment`, `normal_moment` and
    `binormal_moment`, its principal axes must be the tangent, normal and binormal. A batch of vehicles, created by
    `jax.vmap`, contains one vehicle for each path.

    If `reduce` is "max", "min", "integral" (trapezoidal rule) or "mean", the function reduces the outputs over the
    instants, returns a `Reduced`, and stores no samples. `devices` are the devices to use. By default they are the
    device to which the arguments were moved with `jax.device_put`, otherwise all local devices for large inputs.
    `reuse` is the table of an earlier call with the same outputs, `components`, `axes`, and numbers of paths and
    instants. To avoid the allocation of new memory, the arrays of this table are overwritten; do not use them again.

    A program instead of a path, such as a `FrameProgram` or an `EulerTurn`, is evaluated, too. Its outputs are
    `quaternion`, `rate`, `angular_acceleration` and `dcm`; the first three are the default.

    Evaluation is fastest for polynomial paths with a natural or upright frame. The call may be traced, and
    differentiated in forward and reverse mode.

    With `extrapolate=True`, times may be outside [0, duration]; the formulas are extrapolated there. Traced times are
    not checked.

    **Raises:** ValueError for an input that is not a path, unknown outputs, components, axes, reductions or devices,
    times that are neither (n,) nor (b, n) or are outside the path, a missing vehicle, a number of vehicles that differs
    from the number of paths, forces on a banked road along a route that reverses, arguments on different devices
    without `devices`, a `reuse` table that does not match, a rotation-minimizing frame with `reduce` or `reuse`, or
    forces on a road that changes along the way in a batch, with `reduce`, or inside a trace.
    """
    require_axes(axes)
    devices = as_devices(devices)
    if isinstance(paths, AbstractProgram):
        _require_none(frame=frame, reduce=reduce, devices=devices, reuse=reuse, vehicle=vehicle)
        names = PROGRAM_OUTPUTS if outputs is DEFAULT_OUTPUTS else _names(outputs)
        return program_table(paths, times, names, axes, components, continuous, extrapolate)
    task = Task(
        names=_names(outputs),
        components=_one_of(components, ("last", "first"), "components"),
        batched=_batched(paths),
        continuous=continuous,
        reduce=None if reduce is None else _one_of(reduce, REDUCTIONS, "reduce"),
        axes=axes,
        kernel=kernel_choice(),
    )
    if frame is not None and not isinstance(frame, AbstractFrame | RotationMinimizing):
        raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
    count = paths.duration.shape[0] if task.batched else 1
    rows = (count,) if task.batched else ()
    vehicle = _vehicle(task.names, vehicle, rows)
    if any(CHANNELS[name].needs == VEHICLE for name in task.names):
        require_one_direction(paths, vehicle)
    instants = as_seconds(times)
    if devices is None:
        device_of(jax.tree.leaves((paths, instants, vehicle)), ADVICE)
    elif len(devices) == 1 and not is_host(instants):
        instants = jax.device_put(instants, devices[0])
    if instants.ndim == 0 or (instants.ndim > 1 and instants.shape[:-1] != rows):
        expected = f"(n,) or ({count}, n)" if task.batched else "(n,)"
        raise ValueError(f"times must have shape {expected}, but an array of shape {instants.shape} was given")
    if instants.shape[-1] == 0:
        raise ValueError("times must contain at least one instant")
    if not extrapolate:
        require_inside(instants, paths.duration, "path")
    if isinstance(frame, RotationMinimizing):
        return _minimizing(task, paths, frame, instants, reuse, devices, vehicle)
    frame = default_frame(paths) if frame is None else frame
    work = (paths, frame, vehicle)
    if vehicle is not None and vehicle.on_changing_road:
        _require_host(task, work, instants, devices)
    reused = _reused_arrays(reuse, task, (*rows, instants.shape[-1]))
    forced = task.kernel == INTERPRET
    if devices is None and not forced and is_host(*(reused or {}).values()) and is_small(task, work, instants):
        values: Any = evaluated(task, work, instants)
    else:
        traced = is_traced(work, instants)
        values = run(task, work, instants, None if traced else devices, traced, reused)
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
    vehicle: Vehicle | None,
) -> Table:
    """Return the table for a rotation-minimizing frame, which is integrated along each path."""
    if task.reduce is not None or reuse is not None:
        raise ValueError(
            "a rotation-minimizing frame is integrated along the path, so it supports neither reduce nor reuse: "
            "evaluate without them and reduce the arrays"
        )
    if not task.batched:
        require_initial(paths, frame.initial)
    names = tuple(name for name in task.names if name not in FRAME_OUTPUTS)
    other_outputs = (
        evaluate(
            paths, instants, names, components=task.components, devices=devices, vehicle=vehicle, extrapolate=True
        ).values
        if names
        else {}
    )
    values = other_outputs | frame_outputs(task, paths, frame, instants, vehicle)
    ordered = {name: values[name] for name in task.names}
    form: Any = {"batched": task.batched, "components": task.components, "frame": MINIMIZING, "axes": task.axes}
    return Table(time=instants, **ordered, **form)


def _require_none(**arguments: Any) -> None:
    """Raise a ValueError if an argument was given that does not apply to a program."""
    if given := [name for name, value in arguments.items() if value is not None]:
        raise ValueError(f"{given[0]} applies only to paths, but a program was given: omit {given[0]}")


def _names(outputs: Sequence[str | Quantity]) -> tuple[str, ...]:
    if isinstance(outputs, str):
        raise ValueError(
            f"outputs must be a sequence of names, such as ({outputs!r},), but the string {outputs!r} was given"
        )
    names = tuple(dict.fromkeys(map(name_of, outputs)))
    if unknown := [name for name in names if name not in CHANNELS]:
        raise ValueError(f"unknown output {unknown[0]!r}; the known outputs are {', '.join(CHANNELS)}")
    return names


def _vehicle(names: Sequence[str], vehicle: Vehicle | None, rows: tuple[int, ...]) -> Vehicle | None:
    """Return the vehicle, or the batch of one vehicle for each path, for the outputs `names`; None if not needed.

    `rows` is the batch shape of the paths.

    **Raises:** ValueError if a required vehicle or inertia is missing, or if the number of vehicles differs from the
    number of paths.
    """
    needing = [name for name in names if CHANNELS[name].needs]
    if vehicle is not None:
        require_vehicle(vehicle, "the argument vehicle of evaluate")
    for name in needing:
        require(vehicle, CHANNELS[name].needs, f"the output {name!r}")
    if vehicle is None or not (needing or any(CHANNELS[name].gravity for name in names)):
        return None
    used = vehicle
    given = batch_of(used)
    if not given:
        return used
    if given != rows:
        expected = f"one vehicle, or {rows[0]} vehicles (one for each path)" if rows else "one vehicle for the one path"
        raise ValueError(
            f"the output {needing[0]!r} needs {expected}, but the vehicles have the batch shape {given}"
            + ("" if rows else ": pass one vehicle, or map evaluate over the vehicles with jax.vmap")
        )
    return with_batch(used, rows[0])


def _require_host(task: Task, work: Any, instants: Any, devices: Any) -> None:
    """Raise a ValueError if outputs depend on a road that changes along the way, but are not evaluated in NumPy."""
    needing = [name for name in task.names if CHANNELS[name].needs == VEHICLE]
    if needing and (task.batched or devices is not None or not is_small(task, work, instants)):
        raise ValueError(
            f"the output {needing[0]!r} on a road that changes along the way needs one path with concrete values, of a "
            f"kind that is evaluated in NumPy, and at most {FEW_OF_ONE} instants: evaluate the paths one by one, "
            "without reduce and devices, outside jit, grad and vmap"
        )


def _batched(paths: AbstractHodograph) -> bool:
    if not isinstance(paths, AbstractHodograph):
        advice = path_advice(paths)
        if isinstance(paths, list | tuple):
            advice = (
                "stack paths of the same type and shapes with jax.tree.map(lambda *x: jnp.stack(x), *paths), or create "
                "them with jax.vmap"
            )
        message = f"a path or a batch of paths was expected, but {described(paths)} was given"
        raise ValueError(message + (f": {advice}" if advice else ""))
    return jnp.ndim(paths.duration) == 1


def _one_of(value: str, choices: tuple[str, ...], name: str) -> str:
    if value not in choices:
        text = ", ".join(repr(k) for k in choices[:-1]) + f" or {choices[-1]!r}"
        raise ValueError(f"{name} must be {text}, but {value!r} was given")
    return value


def _reused_arrays(reuse: Table | None, task: Task, lead: tuple[int, ...]) -> dict[str, Any] | None:
    if reuse is None:
        return None
    arrays: dict[str, Any] = {name: getattr(reuse, name, None) for name in task.names}
    form = (reuse.batched, reuse.components, reuse.axes) if isinstance(reuse, Table) else None
    if (
        form != (task.batched, task.components, task.axes)
        or any(x is None for x in arrays.values())
        or task.reduce is not None
    ):
        raise ValueError(
            "reuse must be the table of an earlier call with the same outputs, components and axes, and the same "
            "numbers of paths and instants; it cannot be combined with reduce"
        )
    shape = np.shape(next(iter(arrays.values())))
    reused_lead = shape[: len(lead)] if task.components == "last" else shape[-len(lead) :]
    if reused_lead != lead:
        raise ValueError(
            f"reuse must be a table with the same numbers of paths and instants {lead}, but it has {reused_lead}"
        )
    return arrays
