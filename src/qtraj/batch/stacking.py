"""Add the axis of the paths to a request for an evaluation, and give the results the requested axes."""

from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array

from qtraj.algebra import hamilton
from qtraj.batch.task import Task
from qtraj.foundation.namespace import xp


class Driven(eqx.Module):
    """A stack of paths, and one vehicle for each path or None, so that a block contains the vehicles of its paths."""

    paths: Any
    vehicle: Any

    @property
    def duration(self) -> Array:
        """The durations of the paths."""
        return self.paths.duration


def stacked(task: Task, work: Any) -> Any:
    """Return the paths and their own vehicles with a leading axis, and the tuple of frame, axes and shared vehicle."""
    paths, frame, vehicle = work
    lead = lambda x: xp.asarray(x)[None] if eqx.is_array_like(x) else x  # noqa: E731
    paths = paths if task.batched else jax.tree.map(lead, paths)
    if vehicle is not None and vehicle.mass.ndim:
        return Driven(paths, vehicle), (frame, task.axes, None)
    return Driven(paths, None), (frame, task.axes, vehicle)


def results(task: Task, raw: dict[str, Array]) -> dict[str, Array]:
    """Return the results, with axes as requested, from arrays with components first."""
    if task.continuous and "quaternion" in raw:
        raw = raw | {"quaternion": _continuous(raw["quaternion"])}
    return {name: task.ordered(name, x) for name, x in raw.items()}


def _continuous(q: Array) -> Array:
    """Return unit quaternions (4, …, instants) with signs that are continuous in time, as in `rotation.continuous`."""
    return q * hamilton.continuous_signs(xp.sum(q[..., 1:] * q[..., :-1], axis=0))[None]
