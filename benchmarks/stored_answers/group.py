"""Define groups of problems, and build batches of paths, limits and vehicles from plain arrays."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

Fields = dict[str, Any]
"""NumPy arrays by name; the first axis of each array is the number of the problem."""

SPEED = 8.0
"""Typical speed [m/s] of random turns."""

LOOSE = 1e9
"""A limit that no random path reaches; a certificate with this limit contains the largest value."""

FLOOR = 1e-6
"""Smallest limit, for quantities whose largest value is zero or negative."""


class Group(NamedTuple):
    """Problems of one kind: a function that creates them from a random generator, and a function that solves them.

    `names` are the names of the limits, in the order of the last axis of the field "limits".
    """

    make: Callable[[np.random.Generator], Fields]
    answer: Callable[[Fields], Fields]
    names: tuple[str, ...] = ()


def random_states(rng: np.random.Generator, count: int, uniform: bool) -> Fields:
    """Return boundary states of random turns of 0.6 to 3 rad between radii of 10 to 40 m, and their durations.

    With `uniform`, the angular rate is the same at both ends.
    """
    radii, turn = rng.uniform(10, 40, (count, 2)), rng.uniform(0.6, 3.0, count)
    mean = SPEED / np.sqrt(radii.prod(axis=1))
    rates = mean[:, None] * (1.0 if uniform else rng.uniform(0.85, 1.2, (count, 2))) * np.ones((1, 2))
    v = rng.normal(size=(count, 4)) * [1.5, 0.5, 1.5, 0.5]
    zero, height = np.zeros(count), rng.uniform(-2, 2, count)
    return {
        "start_position": np.stack([radii[:, 0], zero, zero], axis=1),
        "start_velocity": np.stack([v[:, 0], rates[:, 0] * radii[:, 0], v[:, 1]], axis=1),
        "end_position": turned(turn, radii[:, 1], zero, height),
        "end_velocity": turned(turn, v[:, 2], rates[:, 1] * radii[:, 1], v[:, 3]),
        "duration": turn / mean * rng.uniform(0.95, 1.2, count),
    }


def turned(angle: np.ndarray, radial: np.ndarray, azimuthal: np.ndarray, axial: np.ndarray) -> np.ndarray:
    """Return the Cartesian components of vectors given by cylindrical components at the azimuths `angle`."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([radial * cos - azimuthal * sin, radial * sin + azimuthal * cos, axial], axis=1)


def states(given: Fields, side: str) -> qt.BoundaryState:
    """Return the batch of boundary states of one side, "start" or "end"."""
    names = [f"{side}_{name}" for name in ("position", "velocity", "acceleration")]
    return jax.vmap(qt.BoundaryState)(*(jnp.asarray(given[name]) for name in names if name in given))


def placements(given: Fields) -> qt.Placement | None:
    """Return the batch of placements, or None if the problems have none."""
    if "origin" not in given:
        return None
    return jax.vmap(qt.Placement)(jnp.asarray(given["origin"]), jnp.asarray(given["orientation"]))


def paths(given: Fields) -> qt.SpiralHelix:
    """Return the batch of spiral-helices with the stored coefficients."""
    numbers = [jnp.asarray(given[name]) for name in ("radius", "angle", "height", "duration")]
    return jax.vmap(qt.SpiralHelix)(*numbers, placements(given))


def coefficients(path: qt.SpiralHelix) -> Fields:
    """Return the coefficients of a batch of spiral-helices."""
    return {name: np.asarray(getattr(path, name)) for name in ("radius", "angle", "height", "duration")}


def limits_of(names: tuple[str, ...], given: Fields) -> qt.Limits:
    """Return the batch of limits with these names, with vehicles if the problems have them."""

    def one(values: Any, vehicle: Any) -> qt.Limits:
        return qt.Limits(**dict(zip(names, values, strict=True)), vehicle=None if vehicle is None else car(vehicle))

    return jax.vmap(one)(
        jnp.asarray(given["limits"]), None if "vehicle" not in given else jnp.asarray(given["vehicle"])
    )


def car(v: Any) -> qt.Vehicle:
    """Return the vehicle of a row of numbers, see `random_vehicles`."""
    return qt.Vehicle(v[0], jnp.diag(v[1:4]), v[4], v[5], v[6:8], v[8])


def random_vehicles(rng: np.random.Generator, count: int, banked: bool) -> np.ndarray:
    """Return mass, three moments of inertia, drag area, rolling resistance, two frictions, and bank, (count, 9).

    The moments about n and b are equal with a bank, so that n and b are principal axes of inertia.
    """
    mass, (x, y, z) = rng.uniform(900, 15_000, count), rng.uniform(0.3, 2.0, (3, count))
    z = y if banked else z
    drag, rolling = rng.uniform(0.3, 7.0, count), rng.uniform(0.005, 0.03, count)
    grip, bank = rng.uniform(0.5, 1.2, (2, count)), rng.uniform(-0.15, 0.15, count) * banked
    return np.stack([mass, mass * (y + z), mass * (x + z), mass * (x + y), drag, rolling, *grip, bank], axis=1)


def largest(names: tuple[str, ...], given: Fields) -> np.ndarray:
    """Return the largest value of each quantity along each path, (problems, limits); NaN if it is undefined."""
    loose = {**given, "limits": np.full((len(given["duration"]), len(names)), LOOSE)}
    return np.asarray(qt.certify(paths(loose), limits_of(names, loose)).values)
