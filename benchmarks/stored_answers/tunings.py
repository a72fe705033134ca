"""Tunings of random boundary states, for both motions, all objectives and several sets of limits."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from .group import Fields, Group, coefficients, largest, limits_of, random_states, random_vehicles, states

COUNT = 8
"""Problems in a group; up to this number, batches share compiled code."""


class Task(NamedTuple):
    """The kind of problems in a group.

    The limits are random fractions, between the two numbers of `share`, of the largest values on the initial paths.
    `corridor` [m] is an additional limit, and `options` are further arguments of `tune`.
    """

    motion: str
    names: tuple[str, ...]
    objective: str = "nearest"
    share: tuple[float, float] = (0.86, 1.02)
    corridor: float | None = None
    options: Any = None


CURVED = ("curvature", "lateral_acceleration")
ROAD = ("friction", "power")
TASKS = {
    "uniform_curvature": Task("uniform", ("curvature",)),
    "uniform_curved": Task("uniform", CURVED),
    "uniform_curved_tight": Task("uniform", CURVED, share=(0.7, 0.9)),
    "uniform_jerk": Task("uniform", ("speed", "jerk")),
    "uniform_slope": Task("uniform", ("longitudinal_acceleration", "slope")),
    "uniform_torsion": Task("uniform", ("torsion", "angular_rate")),
    "uniform_corridor": Task("uniform", ("curvature",), corridor=0.5),
    "uniform_infeasible": Task("uniform", CURVED, share=(0.02, 0.1)),
    "uniform_fastest": Task("uniform", ("speed", "lateral_acceleration"), "fastest", (0.95, 1.3)),
    "uniform_smoothest": Task("uniform", CURVED, "smoothest", (0.95, 1.1)),
    "uniform_road": Task("uniform", ROAD),
    "hermite_curvature": Task("hermite", ("curvature",)),
    "hermite_curved": Task("hermite", CURVED),
    "hermite_curved_tight": Task("hermite", CURVED, share=(0.7, 0.9)),
    "hermite_jerk": Task("hermite", ("speed", "jerk")),
    "hermite_yaw": Task("hermite", ("acceleration", "yaw_rate", "yaw_acceleration")),
    "hermite_torsion": Task("hermite", ("torsion", "angular_rate")),
    "hermite_corridor": Task("hermite", CURVED, corridor=0.5),
    "hermite_infeasible": Task("hermite", CURVED, share=(0.005, 0.03)),
    "hermite_fastest": Task("hermite", ("speed", "lateral_acceleration"), "fastest", (0.95, 1.3)),
    "hermite_fastest_jerk": Task("hermite", ("curvature", "speed", "jerk"), "fastest", (0.95, 1.3)),
    "hermite_smoothest": Task("hermite", CURVED, "smoothest", (0.95, 1.1)),
    "hermite_road": Task("hermite", ROAD),
    "hermite_headings": Task("hermite", CURVED, options={"fixed": ("start.heading", "end.heading")}),
    "hermite_weights": Task(
        "hermite", CURVED, options={"weights": {"start.V_h": 4.0}, "bounds": {"end.V_rho": (-1.5, 1.5)}}
    ),
}


def make(task: Task, rng: np.random.Generator) -> Fields:
    """Return random boundary states, and limits relative to the largest values on the initial paths."""
    given = random_states(rng, COUNT, task.motion == "uniform")
    start, end = states(given, "start"), states(given, "end")
    if task.motion == "uniform":
        path = jax.vmap(qt.SpiralHelix.from_boundary)(start, end)
    else:
        path = jax.vmap(qt.SpiralHelix.hermite)(start, end, jnp.asarray(given["duration"]))
    if task.names == ROAD:
        given["vehicle"] = random_vehicles(rng, COUNT, banked=False)
    values = largest(task.names, given | coefficients(path))
    return given | {"limits": np.maximum(values, 0.1) * rng.uniform(*task.share, values.shape)}


def answer(task: Task, given: Fields) -> Fields:
    """Return result codes, objectives, statuses, and the coefficients of the tuned paths."""
    best = qt.tune(
        states(given, "start"),
        states(given, "end"),
        limits_of(task.names, given),
        objective=task.objective,
        motion=task.motion,
        duration=jnp.asarray(given["duration"]) if task.motion == "hermite" else None,
        corridor=task.corridor,
        **(task.options or {}),
    )
    return {
        "codes": np.asarray(best.code).astype(np.int8),
        "objectives": np.asarray(best.objective),
        "statuses": np.asarray(best.certificate.codes).astype(np.int8),
        **coefficients(best.path),
    }


GROUPS = {name: Group(partial(make, task), partial(answer, task), task.names) for name, task in TASKS.items()}
