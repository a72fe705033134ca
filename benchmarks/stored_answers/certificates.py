"""Certificates of random spiral-helices with limits close to the largest values."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from .group import (
    FLOOR,
    Fields,
    Group,
    coefficients,
    largest,
    limits_of,
    paths,
    placements,
    random_states,
    random_vehicles,
    states,
    turned,
)

COUNT = 64
"""Problems in a group; up to this number, batches share compiled code."""

PLAIN = (
    "curvature",
    "torsion",
    "speed",
    "acceleration",
    "lateral_acceleration",
    "longitudinal_acceleration",
    "slope",
    "angular_rate",
    "angular_acceleration",
    "jerk",
    "yaw_rate",
    "yaw_acceleration",
)
ROAD = ("longitudinal_force", "lateral_force", "normal_load", "friction", "power")
MOMENTS = ("tangential_moment", "normal_moment", "binormal_moment")

MARGINS = np.array([0.05, -0.05, 1e-3, -1e-3, 1e-5, -1e-5, 1e-8, -1e-8])
"""Relative differences between a limit and the largest value of its quantity."""


def make(family: str, names: tuple[str, ...], rng: np.random.Generator) -> Fields:
    """Return random paths of a family, and limits that differ from the largest values by one of `MARGINS`."""
    given = degenerate(rng) if family == "degenerate" else turns(family, rng)
    if set(names) - set(PLAIN):
        given["vehicle"] = random_vehicles(rng, COUNT, "banked" in family)
    values = largest(names, given)
    limits = np.maximum(values * (1 + rng.choice(MARGINS, values.shape)), FLOOR)
    return given | {"limits": np.where(np.isfinite(limits), limits, 1.0)}


def turns(family: str, rng: np.random.Generator) -> Fields:
    """Return paths between random boundary states."""
    kind = family.split("_")[0]
    given = random_states(rng, COUNT, kind == "uniform")
    if kind in ("tilted", "shifted"):
        given["origin"] = np.zeros((COUNT, 3))
        given["orientation"] = np.tile([1.0, 0, 0, 0], (COUNT, 1))
    if kind == "quintic":
        given |= accelerations(given, rng)
    start, end = states(given, "start"), states(given, "end")
    if kind == "uniform":
        path = jax.vmap(qt.SpiralHelix.from_boundary)(start, end)
    else:
        path = jax.vmap(qt.SpiralHelix.hermite)(start, end, jnp.asarray(given["duration"]))
    found = coefficients(path)
    if placements(given) is None:
        return found
    orientation = rng.normal(size=(COUNT, 4)) if kind == "tilted" else given["orientation"]
    return found | {"origin": rng.normal(size=(COUNT, 3)) * 1e3, "orientation": orientation}


def accelerations(given: Fields, rng: np.random.Generator) -> Fields:
    """Return random accelerations at both ends; the mean is the centripetal acceleration."""
    found = {}
    for side in ("start", "end"):
        x, y, _ = given[f"{side}_position"].T
        radius, angle, (vx, vy, _) = np.hypot(x, y), np.arctan2(y, x), given[f"{side}_velocity"].T
        rate = (x * vy - y * vx) / radius**2
        noise = rng.normal(size=(3, COUNT)) * [[0.8], [0.8], [0.3]]
        found[f"{side}_acceleration"] = turned(angle, noise[0] - radius * rate**2, noise[1], noise[2])
    return found


def degenerate(rng: np.random.Generator) -> Fields:
    """Return paths on which quantities are undefined or constant.

    These are straight lines, plane curves with an inflection, curves with a small torsion near an inflection, starts at
    rest, an instant of vertical motion, helices, slow instants, and stops within the path.
    """
    size, t = COUNT // 8, np.polynomial.Polynomial([-3.0, 1.0])
    radius, angle, height = np.zeros((3, 8, size, 4))
    a = rng.uniform(0.8, 1.2, (size, 1))
    radius[0], angle[0], height[0] = a * [20, 3, 0, 0], a * [1, 0, 0, 0], a * [0, 0.5, 0, 0]
    radius[1], angle[1] = a * [20, -2, 0, 0.17], a * [0, 0.2, 0, 0]
    radius[2], angle[2], height[2] = radius[1], angle[1], a * [0, 0.5, 0.2, -0.05]
    radius[3], angle[3], height[3] = a * [20, 0, 0.3, 0], a * [0, 0, 0.03, 0], a * [0, 0, 0.05, 0]
    radius[4], height[4] = a * np.pad((20 + t**2).coef, (0, 1)), a * [0, 1, 0, 0]
    radius[5], angle[5], height[5] = a * [20, 0, 0, 0], a * [0, 0.3, 0, 0], a * [0, 0.5, 0, 0]
    radius[6], angle[6], height[6] = a * (20 + 0.1 * t**3).coef, a * [0, 0.02, 0, 0], a * [0, 0.01, 0.02, 0]
    radius[7], angle[7] = a * (20 + 0.1 * t**3).coef, a * (0.02 * t**3).coef
    rows = {"radius": radius, "angle": angle, "height": height}
    return {name: x.reshape(COUNT, 4) for name, x in rows.items()} | {"duration": np.full(COUNT, 6.0)}


def answer(names: tuple[str, ...], given: Fields) -> Fields:
    """Return statuses, and times and values of the maxima."""
    found = qt.certify(paths(given), limits_of(names, given))
    return {
        "statuses": np.asarray(found.codes).astype(np.int8),
        "times": np.asarray(found.times),
        "values": np.asarray(found.values),
    }


FAMILIES = {
    **{f"uniform_{k}": PLAIN for k in (1, 2)},
    **{f"hermite_{k}": PLAIN for k in (1, 2, 3, 4)},
    **{f"quintic_{k}": PLAIN for k in (1, 2)},
    "tilted": PLAIN,
    "shifted": PLAIN,
    "degenerate": PLAIN,
    "uniform_road": ROAD + MOMENTS,
    **{f"hermite_road_{k}": (*PLAIN, *ROAD, *MOMENTS) for k in (1, 2)},
    **{f"hermite_banked_{k}": (*ROAD, *MOMENTS) for k in (1, 2)},
}
"""The names of the limits by the family of paths."""

GROUPS = {
    family: Group(partial(make, family, names), partial(answer, names), names) for family, names in FAMILIES.items()
}
