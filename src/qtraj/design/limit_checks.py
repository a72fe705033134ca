"""Check the names of limits, their vehicle, and the batch shapes of both."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from qtraj.design.ellipse import OfSpeed
from qtraj.foundation.arrays import concrete
from qtraj.foundation.suggestion import suggestion
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PARAMETERS, VEHICLE, PathQuantity
from qtraj.path.quantity import COMBINED, QUANTITIES, SIDES, quantity
from qtraj.path.vehicle import Vehicle, fixed_parameters, require, require_vehicle
from qtraj.path.vehicle_data import batch_of


def require_shapes(limits: Mapping[str, Any], vehicle: Vehicle | None, batch: tuple[int, ...], what: str) -> None:
    """Raise a ValueError if limits or vehicle have a batch shape other than () and `batch`, the shape of `what`."""
    shapes = {f"the limits have the batch shape {x.shape}": x.shape for x in limits.values()}
    shapes[f"the vehicle has the batch shape {batch_of(vehicle)}"] = batch_of(vehicle)
    for text, shape in shapes.items():
        if shape not in ((), batch):
            raise ValueError(
                f"{text}, but the batch shape of {what} is {batch}: pass limits and a vehicle "
                "for each path, or one set of limits and one vehicle for all paths; for one path and many limits, "
                "use jax.vmap"
            )


def refuse_unknown(names: Collection[str]) -> None:
    """Raise a TypeError for the first of `names`, which are no limits."""
    for name in names:
        advice = suggestion(name, [*QUANTITIES, COMBINED], "limits")
        if name in SIDES:
            entry = SIDES[name]
            advice = f"pass {entry.base}={'(…, None)' if entry.lower else '(None, …)'}"
        raise TypeError(f"Limits has no limit {name!r}: {advice}")


def refuse_changing(limits: Mapping[str, Any], what: str, instead: str) -> None:
    """Raise a ValueError for the first of `limits`, which change along the way or with the speed.

    `what` does not support this.
    """
    for name, limit in limits.items():
        do = "depend on the speed" if isinstance(limit, OfSpeed) else "change along the way"
        raise ValueError(f"{what} supports only limits that do not {do}, but the limit {name} is {limit!r}: {instead}")


def forces_along(vehicle: Vehicle | None, names: Collection[str]) -> list[str]:
    """Return the names of limits on forces of a road that changes along the way.

    On a road that changes in steps, limits on own quantities with parameters of the vehicle are among them: between two
    steps, the parameters are constant.
    """
    if vehicle is None or not vehicle.on_changing_road:
        return []
    return [name for name in names if depends_on_road(quantity(name), vehicle.road)]


def depends_on_road(entry: PathQuantity, road: Any) -> bool:
    """Return whether proofs on a road that changes along the way support a quantity that depends on it."""
    return entry.needs == VEHICLE or (entry.needs == PARAMETERS and road.kind == "step")


def require_known_road(vehicle: Vehicle | None, names: Collection[str]) -> None:
    """Raise a ValueError for an own quantity with parameters that change along the way, unless they do in steps."""
    if vehicle is None or not vehicle.on_changing_road:
        return
    for name in names:
        entry = quantity(name)
        if entry.needs != PARAMETERS or depends_on_road(entry, vehicle.road):
            continue
        rows: Any = [tuple(np.array([0.3, -0.7, 0.4]) + k) for k in range(entry.order + 1)]
        with np.errstate(all="ignore"):
            value = np.asarray(entry.value(Invariants(rows, None, fixed_parameters(vehicle, np.float64))))
        if np.isnan(value):  # parameters that change are NaN
            raise ValueError(
                f"the quantity {entry.base or entry.name} depends on the bank or the friction of a road that changes "
                "linearly along the way, which certify does not support: pass a Road with kind='step'"
            )


def require_needs(names: Collection[str], vehicle: Vehicle | None) -> None:
    """Raise a ValueError if a limit with one of these names needs something that the vehicle does not have."""
    needing = [name for name in names if quantity(name).needs]
    if vehicle is not None:
        require_vehicle(vehicle, f"the limit {needing[0]}" if needing else "the field vehicle of Limits")
    for name in needing:
        require(vehicle, quantity(name).needs, f"the limit {name}")
    if vehicle is not None and any((quantity(name).base or name) == "load_factor" for name in names):
        gravity = concrete(vehicle.gravity)
        if gravity is not None and not np.all(gravity > 0):
            raise ValueError(
                "load_factor is relative to gravity, but the vehicle has gravity = 0: limit the acceleration instead"
            )
