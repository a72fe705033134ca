"""The values of limits to which the search for a route compares, and the shifts of limits that need not allow zero.

The origin of heights is arbitrary, and the load on a road is not zero at rest, so a limit b on such a value x need not
allow zero. The search imposes it as (x + s)/(b + s) ≤ 1, where b + s is a length of the problem, or the size of b.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.foundation.namespace import xp
from qtraj.path.quantity import quantity
from qtraj.path.sides import LOWER

LEAST_LOAD = "normal_load" + LOWER
"""The name of a lower limit on the load."""


def tangents(names: tuple[str, ...], bounds: Float[Any, " limits"]) -> Float[Any, " limits"]:
    """Return the limits on the ratios of the quantities: tangents for angles."""
    if not any(quantity(name).tangent_of for name in names):
        return bounds
    return xp.stack([quantity(name).tangent(bounds[k]) for k, name in enumerate(names)])


def is_shifted(name: str) -> bool:
    """Return whether a limit need not allow zero: a side of a signed value that contains the position, or a least load.

    The shift of a load is multiplied by the square of the duration, like gravity.
    """
    entry = quantity(name)
    return name == LEAST_LOAD or (entry.position and entry.bounds_side and entry.per_time == 0)


def scales(names: tuple[str, ...], bounds: Float[Any, " limits"], sizes: Any = None) -> dict[str, Any]:
    """Return the fields `squares` and `shifts` of a `RouteProblem` for its limits.

    `sizes` (limits,) are the values of the shifted limits; None if no limit is shifted.
    """
    found = tangents(names, bounds)
    shifted = np.array([sizes is not None and is_shifted(name) for name in names], bool)
    if not shifted.any():
        return {"squares": found**2, "shifts": None}
    sides = np.array([quantity(name).side for name in names], float)
    return {"squares": xp.where(shifted, sizes, found) ** 2, "shifts": xp.where(shifted, sizes - sides * found, 0.0)}


def sizes_of(
    names: tuple[str, ...], bounds: Float[np.ndarray, " limits"], length: float
) -> Float[np.ndarray, " limits"]:
    """Return the values of shifted limits: a length [m] for heights, whose origin is arbitrary."""
    units = [quantity(name).unit for name in names]
    return np.array([length if unit == "m" else abs(b) or 1.0 for unit, b in zip(units, bounds, strict=True)])
