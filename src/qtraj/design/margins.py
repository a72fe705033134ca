"""The values of limited quantities at one instant of a path, and their distances from the limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.design.along import Along
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import OfSpeed
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import COMBINED, quantity
from qtraj.path.road_on_path import road_on
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.values import values

PARTS = ("longitudinal_acceleration_max", "lateral_acceleration", "speed")
"""The quantities of which the combined acceleration consists."""


def road_at(limits: Any, path: AbstractHodograph, t: ScalarLike) -> RoadParameters:
    """Return the parameters of the vehicle of `limits` at one instant `t` [s] of a path."""
    if not limits.along_road:
        return limits.road(path.duration.dtype)
    if is_traced(path, t, limits):
        raise ValueError(
            "the margins of forces on a road that changes along the way need concrete values: pass an array of times "
            "outside jit, grad and vmap"
        )
    return road_on(limits.vehicle, path).at(np.asarray(t, float))


def values_of(
    given: Mapping[str, Any], path: AbstractHodograph, t: ScalarLike, road: RoadParameters
) -> dict[str, Scalar]:
    """Return the quantities that the limits `given` bound, at one instant `t` [s], by name."""
    names = [name for name in given if name != COMBINED]
    found = values(path, t, names, road)
    if COMBINED in given:
        found[COMBINED] = given[COMBINED].usage(*values(path, t, PARTS).values())
    return {name: found[name] for name in given}


def margins_of(
    given: Mapping[str, Any], path: AbstractHodograph, t: ScalarLike, road: RoadParameters
) -> dict[str, Scalar]:
    """Return the distances of the quantities from their limits at one instant `t` [s]; negative if violated."""
    limits = dict(given)
    if any(isinstance(x, Along) for x in limits.values()):
        s = path.arc_length(t)
        limits = {name: x.at(s) if isinstance(x, Along) else x for name, x in limits.items()}
    if any(isinstance(x, OfSpeed) for x in limits.values()):
        speed = values(path, t, ["speed"])["speed"]
        limits = {name: at_speed(x, speed) for name, x in limits.items()}
    found = values_of(given, path, t, road)
    return {name: quantity(name).side * (limits[name] - value) for name, value in found.items()}


def at_speed(limit: Any, speed: Any) -> Any:
    """Return the value of a limit at a speed [m/s]; the limit on the combined acceleration is 1."""
    if isinstance(limit, BySpeed):
        return limit.at(speed)
    return 1.0 + 0.0 * speed if isinstance(limit, OfSpeed) else limit
