"""The limits of a search: in reduced units, divided by the vehicle's factors, and tightened."""

from collections.abc import Iterable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from qtraj.design import one_sided
from qtraj.design.divisors import divisors, reduced as reduced_limits
from qtraj.design.limits import Limits
from qtraj.foundation.arrays import concrete
from qtraj.foundation.namespace import namespace
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.quantity import CORRIDOR, quantity
from qtraj.path.road_parameters import NO_VEHICLE
from qtraj.path.vehicle import Vehicle

TARGET_RATIO = 1 - 4e-9
"""The fraction of each upper limit that the search uses."""

MIN_LIMIT = 1e-100
"""Lower bound on the limits in a search; the square of a smaller limit would underflow."""


def named_limits(limits: Limits, corridor: Any = None) -> dict[str, Any]:
    """Return the limits that do not change along the way, by name; the corridor is the last."""
    return limits.constant() | ({} if corridor is None else {CORRIDOR.name: corridor})


def search_limits(limits: Limits, corridor: Any, count: int, clearances: Iterable[str] = ()) -> dict[str, Any]:
    """Return the limits (count,) of each of `count` problems, by name, as a search uses them.

    The names in `clearances` are those of constraints about obstacles.

    The names are sorted, because JAX sorts them, too. The results are NumPy arrays if the limits have concrete values.
    """
    reduced = named_limits(limits, corridor) | reduced_limits(limits)
    known = all(concrete(x) is not None for x in reduced.values())
    xp: Any = np if known else jnp
    values = {name: xp.asarray(x, float) for name, x in sorted(reduced.items())}
    found = {name: target(name, values) for name in values} | dict.fromkeys(clearances, 0.0)
    return {name: xp.broadcast_to(found[name], (count,)) for name in sorted(found)}


def target(name: str, limits: Mapping[str, Any]) -> Any:
    """Return the limit that a search uses, so that rounding errors cannot violate the given one of `limits`.

    A height has its margin in `constraints`, because a stricter limit would exclude an end exactly at the limit.
    """
    entry, limit = quantity(name), limits[name]
    if entry.of_position:
        return limit
    if entry.bounds_side:
        return one_sided.stricter(name, limits, 1 - TARGET_RATIO)
    wanted = limit / TARGET_RATIO if entry.lower else TARGET_RATIO * limit
    return namespace(limit).maximum(wanted, MIN_LIMIT)


def given(limits: Mapping[str, Any]) -> dict[str, Any]:
    """Return the limits from which `target` computes these limits of a search; obstacles have none."""
    found = {}
    for name, limit in limits.items():
        if names_obstacle(name):
            continue
        entry = quantity(name)
        if entry.of_position:
            found[name] = limit
        elif entry.bounds_side:
            found[name] = one_sided.stricter(name, limits, TARGET_RATIO - 1)
        else:
            found[name] = limit * TARGET_RATIO if entry.lower else limit / TARGET_RATIO
    return found


def user_value_at(ratio: Any, name: str, limits: Mapping[str, Any]) -> Any:
    """Return `value_at` for limits of the user, in which angles are not tangents."""
    tangents = {key: x if key == CORRIDOR.name else quantity(key).tangent(x) for key, x in limits.items()}
    return quantity(name).of_tangent(value_at(ratio, name, tangents))


def value_at(ratio: Any, name: str, limits: Mapping[str, Any]) -> Any:
    """Return the value of a quantity whose constraint value is ln(`ratio`)."""
    entry = quantity(name)
    if entry.bounds_side:
        return one_sided.value_at(ratio, name, limits)
    return limits[name] / ratio if entry.lower else ratio * limits[name]


def factors(names: Any, vehicle: Vehicle | None) -> dict[str, float]:
    """Return, by name, the numbers by which a search divides the user's limits."""
    road = NO_VEHICLE if vehicle is None else vehicle.parameters()
    own = divisors([name for name in names if name != CORRIDOR.name], road)
    return {name: float(own.get(name, 1.0)) for name in names}
