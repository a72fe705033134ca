"""Retimings of random spiral-helices and routes, for several sets of limits and conditions at the ends."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from . import drives
from .group import Fields, Group, coefficients, paths, random_states, random_vehicles, states

COUNT, KNOTS = 9, 64

RANGES = {
    "speed": (7.0, 15.0),
    "acceleration": (2.0, 5.0),
    "lateral_acceleration": (1.5, 4.0),
    "longitudinal_acceleration": (1.0, 3.0),
    "jerk": (0.8, 4.0),
    "yaw_rate": (0.2, 0.5),
    "yaw_acceleration": (0.2, 0.8),
    "friction": (0.3, 0.9),
    "power": (1e4, 6e4),
}
"""Ranges of random limits."""

DRIVEN = ("speed", "lateral_acceleration", "longitudinal_acceleration")


class Task(NamedTuple):
    """The kind of problems in a group: the kind of path, the names of the limits, and the ends.

    An end is None (free), "rest" or "given" (a random speed).
    """

    kind: str
    names: tuple[str, ...]
    ends: tuple[str | None, str | None] = (None, None)


TASKS = {
    "free": Task("turn", ("acceleration", *DRIVEN)),
    "rest": Task("turn", ("acceleration", *DRIVEN), ("rest", "rest")),
    "jerk": Task("turn", (*DRIVEN, "jerk"), ("given", "given")),
    "jerk_rest": Task("turn", (*DRIVEN, "jerk"), ("rest", "rest")),
    "yaw": Task("turn", ("speed", "yaw_rate", "yaw_acceleration"), ("given", None)),
    "road": Task("turn", ("speed", "friction", "power"), ("rest", "given")),
    "route": Task("winding", (*DRIVEN, "jerk")),
    "spline": Task("splines", DRIVEN, ("given", "given")),
    "stops": Task("stopping", ("speed", "acceleration", "lateral_acceleration", "jerk")),
}


def make(task: Task, rng: np.random.Generator) -> Fields:
    """Return random paths, limits and speeds at the ends; NaN is a free end."""
    if task.kind == "turn":
        given = random_states(rng, COUNT, uniform=False)
        ends = states(given, "start"), states(given, "end"), jnp.asarray(given["duration"])
        given = coefficients(jax.vmap(qt.SpiralHelix.hermite)(*ends))
    else:
        given = getattr(drives, task.kind)(rng, COUNT)
    if "friction" in task.names:
        given["vehicle"] = random_vehicles(rng, COUNT, banked=True)
        given["vehicle"][:, 0] = 1500.0
    limits = np.stack([rng.uniform(*RANGES[name], COUNT) for name in task.names], axis=1)
    speeds = {None: np.full(COUNT, np.nan), "rest": np.zeros(COUNT), "given": rng.uniform(2.0, 4.0, COUNT)}
    return given | {"limits": limits, "speeds": np.stack([speeds[x] for x in task.ends], axis=1)}


def answer(task: Task, given: Fields) -> Fields:
    """Return result codes, durations, statuses, and speeds at the ends."""
    found = [_retimed(task, given, k) for k in range(len(given["limits"]))]
    return {
        "codes": np.array([int(x.code) for x in found], np.int8),
        "durations": np.array([float(x.duration) for x in found]),
        "statuses": np.array([np.asarray(x.certificate.codes) for x in found], np.int8),
        "speeds": np.array([np.asarray(x.speeds) for x in found]),
    }


def _retimed(task: Task, given: Fields, k: int) -> qt.Retimed:
    if task.kind == "turn":
        path: Any = jax.tree.map(lambda x: x[k], paths(given))
    else:
        path = drives.route(given, k)
    start, end = (None if np.isnan(v) else v for v in given["speeds"][k].tolist())
    return qt.retime(path, drives.one(task.names, given, k), start, end, knots=KNOTS)


GROUPS = {name: Group(partial(make, task), partial(answer, task), task.names) for name, task in TASKS.items()}
