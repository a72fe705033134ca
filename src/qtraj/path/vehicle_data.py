"""Convert vehicles to labelled quantities of a dataset and back, and add batch axes to vehicles."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np

from qtraj.foundation.namespace import xp
from qtraj.foundation.record import Quantity
from qtraj.path.road import Road
from qtraj.path.vehicle import Vehicle

PREFIX = "vehicle_"

_FIELDS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "mass": ("kg", "mass of the vehicle", ()),
    "inertia": ("kg m2", "inertia tensor of the vehicle, body axes", ("body", "body_column")),
    "drag_area": ("m2", "drag coefficient of the vehicle times its frontal area", ()),
    "rolling_resistance": ("1", "coefficient of rolling resistance", ()),
    "friction": ("1", "coefficients of friction, along and across the vehicle", ("friction_axis",)),
    "bank": ("rad", "bank angle of the road, positive if the left side is lower", ()),
    "air_density": ("kg m-3", "density of the air", ()),
    "gravity": ("m s-2", "gravity, along -z", ()),
    "wheelbase": ("m", "wheelbase of the vehicle", ()),
}
"""Unit, meaning and axes of each parameter of a vehicle."""

_ROAD: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "distance": ("m", "distances along the path at which the road is defined", ("road_point",)),
    "bank": ("rad", "bank angle of the road, positive if the left side is lower", ("road_point",)),
    "friction": ("1", "coefficients of friction, along and across the vehicle", ("road_point", "friction_axis")),
    "inverted": ("1", "whether the road is above the vehicle", ("road_point",)),
    "left": ("1", "direction to the left of the vehicle; zero where the road is level across", ("road_point", "world")),
}
"""The same for a road that changes along the way."""

_OF_ROAD = PREFIX + "road_"


def vehicle_quantities(vehicle: Vehicle | None) -> dict[str, Quantity]:
    """Return the parameters of a vehicle as labelled quantities, whose names begin with `PREFIX`; empty for None."""
    values = {name: getattr(vehicle, name, None) for name in _FIELDS}
    found = {PREFIX + name: Quantity(x, *_FIELDS[name]) for name, x in values.items() if x is not None}
    if vehicle is None or vehicle.road is None:
        return found
    of_road = {name: getattr(vehicle.road, name) for name in _ROAD}
    if of_road["left"] is not None:
        of_road["left"] = [x or (0.0, 0.0, 0.0) for x in of_road["left"]]
    found |= {_OF_ROAD + name: Quantity(np.array(x), *_ROAD[name]) for name, x in of_road.items() if x is not None}
    steps = Quantity(np.array(vehicle.road.kind == "step"), "1", "whether the road changes in steps, not linearly")
    return found | {_OF_ROAD + "steps": steps}


def vehicle_from(variables: Mapping[Any, Any]) -> Vehicle | None:
    """Create the vehicle from the quantities in a dataset; None if the dataset contains no mass of a vehicle."""
    values = {name: np.asarray(variables[PREFIX + name]) for name in _FIELDS if PREFIX + name in variables}
    return Vehicle(**values, road=_road_from(variables)) if "mass" in values else None


def _road_from(variables: Mapping[Any, Any]) -> Road | None:
    values: dict[str, Any] = {x: np.asarray(variables[_OF_ROAD + x]) for x in _ROAD if _OF_ROAD + x in variables}
    if "distance" not in values:
        return None
    if "inverted" in values:
        values["inverted"] = values["inverted"].astype(bool)
    if "left" in values:
        values["left"] = [x if x.any() else None for x in values["left"]]
    return Road(**values, kind="step" if np.asarray(variables[_OF_ROAD + "steps"]) else "linear")


def axes_of(parameter: str) -> int:
    """Return the number of axes of a parameter of a single vehicle."""
    return len(_FIELDS[parameter][2])


def batch_of(vehicle: Vehicle | None) -> tuple[int, ...]:
    """Return the batch shape of a vehicle; () for a single vehicle or None."""
    if vehicle is None:
        return ()
    values = {name: getattr(vehicle, name) for name in _FIELDS}
    shapes = [np.shape(x)[: np.ndim(x) - axes_of(name)] for name, x in values.items() if x is not None]
    return max(shapes, key=len)


def with_batch(vehicle: Vehicle | None, count: int) -> Vehicle | None:
    """Return the vehicle with a batch axis of length `count` on every parameter; None if `vehicle` is None."""
    if vehicle is None:
        return None
    names = [name for name in _FIELDS if getattr(vehicle, name) is not None]
    values = [getattr(vehicle, name) for name in names]
    core = [axes_of(name) for name in names]
    new = [xp.broadcast_to(x, (count, *x.shape[x.ndim - n :])) for x, n in zip(values, core, strict=True)]
    return eqx.tree_at(lambda v: [getattr(v, name) for name in names], vehicle, new)
