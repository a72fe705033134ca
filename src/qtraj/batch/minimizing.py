"""Compute outputs that depend on a rotation-minimizing frame, which must be integrated along the path.

`FrameProgram` integrates the frame. Outputs that depend only on the path are evaluated as for other frames.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.algebra.vector import norm
from qtraj.batch.body_forces import path_force
from qtraj.batch.task import Task
from qtraj.foundation.arrays import is_traced
from qtraj.motion.attitude import Attitude
from qtraj.motion.dynamics import torque
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.rotation_minimizing import RotationMinimizing
from qtraj.path.frame_components import UP, triple
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.rate_axes import BODY
from qtraj.path.regularity import has_tangent
from qtraj.path.trihedral import Natural, frames
from qtraj.path.vehicle import Vehicle

FRAME_OUTPUTS = ("dcm", "quaternion", "gibbs", "rate", "angular_acceleration", "force", "moment", "defined")
"""Outputs that depend on the frame."""


def frame_outputs(
    task: Task,
    paths: AbstractHodograph,
    frame: RotationMinimizing,
    times: Float[Array, "*rows n"],
    vehicle: Vehicle | None = None,
) -> dict[str, Array]:
    """Compute the requested outputs that depend on the frame; the quaternion's sign is continuous on each path."""
    names = tuple(name for name in FRAME_OUTPUTS if name in task.names)
    if not names:
        return {}
    if not task.batched:
        return _ordered(task, _along(FrameProgram(paths, frame), times, names, task.axes, vehicle), 1)
    rows = jnp.broadcast_to(times, (paths.duration.shape[0], times.shape[-1]))
    values = _many(paths, frame, rows, names, task.axes, vehicle)
    if not is_traced(values, paths, times) and any(bool(jnp.isnan(x).any()) for x in values.values()):
        raise ValueError(
            "a path of this batch turns too fast for the number of anchors that the paths of a batch have, or is not "
            "finite: evaluate its paths one by one, or divide them into windows"
        )
    return _ordered(task, values, 2)


def _ordered(task: Task, values: dict[str, Array], lead: int) -> dict[str, Array]:
    """Move the component axes to the front if the task requests it; `lead` is the number of the other axes."""
    if task.components == "last":
        return values
    return {name: jnp.moveaxis(x, range(lead, x.ndim), range(x.ndim - lead)) for name, x in values.items()}


@eqx.filter_jit
def _many(
    paths: AbstractHodograph,
    frame: RotationMinimizing,
    times: Array,
    names: tuple[str, ...],
    axes: str,
    vehicle: Vehicle | None,
) -> dict[str, Any]:
    own = 0 if vehicle is not None and vehicle.mass.ndim else None
    along = lambda path, t, vehicle: _along(FrameProgram(path, frame), t, names, axes, vehicle)  # noqa: E731
    return eqx.filter_vmap(along, in_axes=(eqx.if_array(0), 0, own))(paths, times, vehicle)


@eqx.filter_jit
def _along(
    program: FrameProgram, times: Float[Array, " n"], names: tuple[str, ...], axes: str, vehicle: Vehicle | None
) -> dict[str, Any]:
    at = jax.vmap(lambda t: program.at(t, axes))(times)
    formulas = {
        "dcm": lambda: jax.vmap(rotation.to_dcm)(at.quaternion),
        "quaternion": lambda: at.quaternion,
        "gibbs": lambda: jax.vmap(rotation.to_gibbs)(at.quaternion),
        "rate": lambda: at.rate,
        "angular_acceleration": lambda: at.acceleration,
        "force": lambda: _forces(program.path, vehicle, times, at.quaternion, axes),
        "moment": lambda: jax.vmap(lambda a: _moment(a, vehicle, axes))(jax.vmap(program)(times)),
        "defined": lambda: jax.vmap(lambda t: _defined(program.path, t))(times),
    }
    return {name: formulas[name]() for name in names}


def _forces(path: AbstractHodograph, vehicle: Any, times: Array, quaternions: Array, axes: str) -> Array:
    """Return the force (n, 3) [N] that moves a vehicle along a path, in the axes of the frame or in world axes."""

    def at(t: Array, q: Array) -> Array:
        r = path.derivatives(t, 2)
        force = jnp.stack(path_force(vehicle.parameters(r.dtype), [triple(x) for x in r], UP, norm(r[1])))
        return force if axes != BODY else quaternion.rotate(quaternion.conjugate(q), force)

    return jax.vmap(at)(times, quaternions)


def _moment(at: Attitude, vehicle: Any, axes: str) -> Array:
    """Return the moment (3,) [N m] that makes a vehicle rotate with a frame, in the frame's axes or in world axes."""
    moment = torque(at, vehicle.inertia_in_frame())
    return moment if axes == BODY else quaternion.rotate(at.quaternion, moment)


def _defined(path: AbstractHodograph, t: Array) -> Array:
    """Return whether the speed at the time `t` [s] is not zero."""
    i, _, span, _ = frames(path, t.astype(path.duration.dtype), Natural())
    return has_tangent(i, span)
