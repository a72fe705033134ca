"""Build the paths and limits of many points of a sweep at once, if their parameters are numbers of a path scenario.

To read a scenario anew for each point takes milliseconds. Here one point is read, and the numbers of all others replace
its numbers in arrays. Points whose numbers are not certainly valid are left to the reader.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Int

from qtraj.design.bound import bound_of
from qtraj.design.tuning.initial import initial_paths
from qtraj.foundation.outcome import ResultCode
from qtraj.path.boundary import BoundaryState
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.placement import Placement
from qtraj.path.quantity import QUANTITIES
from qtraj.scenario.path import PathScenario, PathTask

Points = Mapping[str, np.ndarray]
Rows = Bool[np.ndarray, " n"]

AXES = ("x", "y", "z")
LIMITS, VEHICLE = "limits.", "vehicle."

STATES = {f"{end}.{part}" for end in ("start", "end") for part in (*(f"velocity.{x}" for x in AXES), "speed")}
STATES |= {f"{end}.position.{x}" for end in ("start", "end") for x in AXES}
"""Parameters of boundary states."""

TIMES = ("duration", "tune.duration")

MASSES = {"mass": False, "drag_area": True, "rolling_resistance": True, "air_density": True, "gravity": True}
"""Numbers of a vehicle, and whether they may be zero."""


class Together(NamedTuple):
    """Points that are one batch: a task whose arrays have a batch axis, and which of all points it contains.

    `placement` is that of all points, without a batch axis. `ill_posed` are those of its points that have no path.
    """

    task: PathTask
    placement: Placement | None
    rows: Rows
    ill_posed: Rows

    def at(self, places: Int[np.ndarray, " n"]) -> Together:
        """Return the points at some places of the batch."""
        names = ("path", "start", "end", "limits", "duration", "turn")
        parts = jax.tree.map(lambda x: np.asarray(x)[places], {name: getattr(self.task, name) for name in names})
        return self._replace(task=replace(self.task, **parts), ill_posed=np.zeros(len(places), bool))


def supports(names: Mapping[str, Any]) -> bool:
    """Return whether points with these parameters can be one batch.

    A speed scales the velocity of the scenario, which is known only if no other parameter changes it.
    """
    turned = {name.partition(".")[0] for name in names if ".velocity." in name}
    return not any(f"{end}.speed" in names for end in turned) and all(
        name in STATES or name in TIMES or name.removeprefix(VEHICLE) in MASSES or _limit_of(name) for name in names
    )


def valid_rows(points: Points) -> Rows:
    """Return which points certainly have valid numbers."""
    good = np.ones(len(next(iter(points.values()))), bool)
    for name, values in points.items():
        zero = name.startswith(VEHICLE) and MASSES[name.removeprefix(VEHICLE)]
        good &= np.isfinite(values)
        if name not in STATES or name.endswith(".speed"):
            good &= values >= 0 if zero else values > 0
    for name, values in points.items():
        if (entry := _limit_of(name)) is not None and good.any() and not _is_bound(values[good].max(), entry.name):
            good &= False  # the reader finds those that are too large, such as an angle above a half turn
    return good


def together(scenario: PathScenario, task: PathTask, points: Points, rows: Rows) -> Together | None:
    """Return the points in `rows` as one task, or None; `scenario` and `task` are those of one of these points.

    **Raises:** ValueError if they cannot be one task.
    """
    count, moved = int(rows.sum()), [name for name in points if name in STATES or name in TIMES]
    chosen = {name: values[rows].astype(float) for name, values in points.items()}
    given, vehicle = task.limits, task.limits.vehicle
    if task.deviations is not None:
        return None
    if given.varying or given.keep_out is not None or (vehicle is not None and vehicle.road is not None):
        return None
    if moved and (scenario.start is None or scenario.end is None or scenario.start.acceleration is not None):
        return None
    limits = _repeated(task.limits, count)
    for name, values in chosen.items():
        if name.startswith(LIMITS):
            field = name.removeprefix(LIMITS)
            limits = eqx.tree_at(lambda x, field=field: getattr(x, field), limits, values)
        elif name.startswith(VEHICLE):
            field = name.removeprefix(VEHICLE)
            limits = eqx.tree_at(lambda x, field=field: getattr(x.vehicle, field), limits, values)
    duration = task.duration if task.duration is None else np.full(count, float(task.duration))
    duration = next((chosen[name] for name in TIMES if name in chosen), duration)
    turn = None if task.turn is None else np.full(count, task.turn)
    whole = replace(task, limits=limits, duration=duration, turn=turn)  # pyright: ignore[reportArgumentType]
    if not moved:
        fields = {name: _repeated(getattr(task, name), count) for name in ("path", "start", "end")}
        return Together(replace(whole, **fields), task.path.placement, rows, np.zeros(count, bool))
    start, end = (_states(getattr(scenario, x), x, chosen, count) for x in ("start", "end"))
    placement = task.path.placement
    path, codes = initial_paths(start, end, task.objective, task.motion, duration, task.turns, placement)
    return Together(replace(whole, path=path, start=start, end=end), placement, rows, codes != ResultCode.successful)


def _states(part: Any, end: str, points: Points, count: int) -> BoundaryState:
    """Return the states of all points; parameters change a state in their order, as in a scenario."""
    state = {name: np.tile(np.asarray(getattr(part, name), float), (count, 1)) for name in ("position", "velocity")}
    for name, values in points.items():
        own, _, rest = name.partition(".")
        if own != end or name not in STATES:
            continue
        if rest == "speed":
            length = np.sqrt(np.sum(state["velocity"] ** 2, axis=1))
            if not (length > 0).all():
                raise ValueError(f"the parameter '{name}' scales a velocity, which is zero")
            state["velocity"] = state["velocity"] * (values / length)[:, None]
        else:
            vector, axis = rest.split(".")
            state[vector][:, AXES.index(axis)] = values
    one = BoundaryState(part.position, part.velocity)
    return eqx.tree_at(lambda x: (x.position, x.velocity), one, (state["position"], state["velocity"]))


def _repeated(tree: Any, count: int) -> Any:
    return jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), (count, *np.shape(x))), tree)


def _limit_of(name: str) -> PathQuantity | None:
    return QUANTITIES.get(name.removeprefix(LIMITS)) if name.startswith(LIMITS) else None


def _is_bound(value: float, name: str) -> bool:
    try:
        bound_of(float(value), name)
    except ValueError:
        return False
    return True
