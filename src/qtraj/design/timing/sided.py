"""Limits on one side of a signed value along a timing, as affine functions of a = u̇² and a' = da/du.

The longitudinal acceleration and the yaw acceleration are p·a + q·a'. With the sign of the side, the limit is x ≤ b,
where b is positive if the limit allows zero. It is imposed as (x + s)/(b + s) ≤ 1 with the shift s, which is zero for
b > 0. A lower bound l on the speed is imposed on its square: (s − |r'|² a)/(s − l²) ≤ 1 with s = 2l².
"""

from collections.abc import Mapping
from typing import Any

from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import quantity

SLOWEST = "speed_min"
"""The lower bound on the speed."""

SIDED = (
    SLOWEST,
    "longitudinal_acceleration_min",
    "longitudinal_acceleration_max",
    "yaw_acceleration_min",
    "yaw_acceleration_max",
)
"""Limits that are affine in a and a'."""

YAW_RATES = ("yaw_rate_min", "yaw_rate_max")
"""Limits that are upper bounds on a where the path turns to their side."""


def reserve(name: str, bounds: Mapping[str, Scalar]) -> tuple[Any, Any]:
    """Return b + s and s of the module for one limit; b + s is positive."""
    bound = bounds[name]
    if name == SLOWEST:
        return bound * bound, 2 * bound * bound
    b = quantity(name).side * bound
    xp, size = namespace(b), abs(b)
    room = xp.where(size > 0, size, _typical(name, bounds))
    return room, xp.where(b > 0, 0.0 * size, room - b)


def _typical(name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the size of the other limits on quantities of this unit, or 1 without any, as the unit of a bound 0."""
    unit, found = quantity(name).unit, 0.0
    for other, bound in bounds.items():
        if quantity(other).unit == unit:
            found = namespace(bound).maximum(found, abs(bound))
    xp = namespace(found)
    return xp.where(found > 0, found, 1.0)


def reduced(bounds: Mapping[str, Scalar], fraction: float) -> dict[str, Scalar]:
    """Return the limits, each stricter by `fraction` of its size; see `reserve` for two-sided limits."""
    found = {}
    for name, bound in bounds.items():
        if name in SIDED:
            room = abs(bound) if name == SLOWEST else reserve(name, bounds)[0]
            found[name] = bound - quantity(name).side * fraction * room
        else:
            found[name] = bound * (1 - fraction)
    return found


def row(name: str, rates: tuple[Any, Any], bounds: Mapping[str, Scalar]) -> tuple[Any, Any, Any]:
    """Return the coefficients of 1, a and a' in the imposed function; `rates` are those of a and a' in the value.

    For the lower bound on the speed, the value is its square.
    """
    (room, shift), side = reserve(name, bounds), quantity(name).side
    p, q = rates
    return shift / room + 0.0 * p, side * p / room, side * q / room


def value_at(usage: Any, name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the value of a limited quantity from `usage`, the value of the imposed function or ratio to the limit."""
    if name not in SIDED:
        return usage * bounds[name]
    room, shift = reserve(name, bounds)
    if name == SLOWEST:
        xp = namespace(usage, room)
        return xp.sqrt(xp.maximum(shift - usage * room, 0.0))
    return quantity(name).side * (usage * room - shift)


def excludes_zero(bounds: Mapping[str, Scalar]) -> bool:
    """Return whether a limit on an acceleration is known not to allow zero: then the fastest timing must accelerate."""
    sided = [name for name in bounds if name in SIDED and name != SLOWEST]
    return any(quantity(name).side * float(bounds[name]) < 0 for name in sided)
