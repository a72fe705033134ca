"""The limits of a search: in reduced units, divided by the vehicle's factors, and tightened."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from qtraj.design.limits import Limits, divisors
from qtraj.foundation.arrays import concrete
from qtraj.path.quantity import CORRIDOR
from qtraj.path.vehicle import NO_VEHICLE, Vehicle

TARGET_RATIO = 1 - 4e-9
"""The fraction of each limit that the search uses, so that rounding errors cannot violate the user's limit."""

MIN_LIMIT = 1e-100
"""Lower bound on the limits in a search; the square of a smaller limit would underflow."""


def named_limits(limits: Limits, corridor: Any = None) -> dict[str, Any]:
    """Return the limits that are set, by name; the corridor is the last."""
    return limits.given() | ({} if corridor is None else {CORRIDOR.name: corridor})


def search_limits(limits: Limits, corridor: Any, count: int) -> dict[str, Any]:
    """Return the limits (count,) of each of `count` problems, by name, as a search uses them.

    The names are sorted, because JAX sorts them, too. The results are NumPy arrays if the limits have concrete values.
    """
    reduced = named_limits(limits, corridor) | limits.reduced()
    known = all(concrete(x) is not None for x in reduced.values())
    xp: Any = np if known else jnp
    return {
        name: xp.broadcast_to(xp.maximum(TARGET_RATIO * xp.asarray(x, float), MIN_LIMIT), (count,))
        for name, x in sorted(reduced.items())
    }


def factors(names: Any, vehicle: Vehicle | None) -> dict[str, float]:
    """Return, by name, the numbers by which a search divides the user's limits."""
    road = NO_VEHICLE if vehicle is None else vehicle.parameters()
    own = divisors([name for name in names if name != CORRIDOR.name], road)
    return {name: float(own.get(name, 1.0)) for name in names}
