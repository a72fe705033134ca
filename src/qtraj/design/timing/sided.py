"""Limits on one side of a signed value along a timing, as affine functions of a = u̇² and a' = da/du.

The longitudinal, the vertical and the yaw acceleration are p·a + q·a', and the normal load of a vehicle is c + p·a. How
their limits are imposed is described in `design.one_sided`. A lower bound l on the speed is imposed on its square:
(2l² − |r'|² a)/l² ≤ 1.
"""

from collections.abc import Mapping
from typing import Any

from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import OfSpeed
from qtraj.design.one_sided import scale_and_shift, stricter, value_at
from qtraj.design.timing import formula_limits
from qtraj.design.timing.road import LOADS
from qtraj.design.varying import all_values
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import quantity
from qtraj.path.sides import LOWER, UPPER

SLOWEST = "speed_min"
"""The lower bound on the speed."""

SIDED = (
    SLOWEST,
    "longitudinal_acceleration_min",
    "longitudinal_acceleration_max",
    "yaw_acceleration_min",
    "yaw_acceleration_max",
    "vertical_acceleration_min",
    "vertical_acceleration_max",
    *LOADS,
)
"""Limits that are affine in a and a'."""

BY_SPEED = 10.0
"""Factor on the fraction for limits that depend on the speed, because a slower timing may violate them, too, and they
may be exceeded in a small part of a cell where they bend."""

RATES = ("yaw_rate", "vertical_speed", "curvature_rate")
"""Signed quantities that are proportional to √a."""

SIDES_OF_RATES = tuple(side for name in RATES for side in (name + LOWER, name + UPPER))
"""Limits that are upper bounds on a where the path turns or climbs to their side."""


def reduced(bounds: Mapping[str, Scalar], fraction: float) -> dict[str, Scalar]:
    """Return the limits, each stricter by `fraction`."""
    numbers = {name: x for name, x in bounds.items() if not isinstance(x, OfSpeed)}
    return {name: _reduced(name, numbers if name in numbers else bounds, fraction) for name in bounds}


def _reduced(name: str, bounds: Mapping[str, Any], fraction: float) -> Any:
    if isinstance(bounds[name], BySpeed) and name in SIDED:
        return bounds[name].stricter(quantity(name).side, BY_SPEED * fraction)
    if isinstance(bounds[name], OfSpeed):
        return bounds[name].scaled(1 - BY_SPEED * fraction)
    if formula_limits.is_formula(name):
        return formula_limits.reduced(name, bounds, fraction)
    if name in SIDED and name != SLOWEST:
        return stricter(name, bounds, fraction)
    return bounds[name] * (1 + fraction if name == SLOWEST else 1 - fraction)


def row(name: str, rates: tuple[Any, Any], bounds: Mapping[str, Scalar], constant: Any = 0.0) -> tuple[Any, Any, Any]:
    """Return the coefficients of 1, a and a' in the imposed function; `constant` and `rates` are those in the value.

    For the lower bound on the speed, the value is its square.
    """
    (p, q), side, square = rates, quantity(name).side, bounds[name] ** 2
    scale, shift = _of_slowest(square) if name == SLOWEST else scale_and_shift(name, bounds)
    return (shift + side * constant) / scale + 0.0 * p, side * p / scale, side * q / scale


def _of_slowest(square: Any) -> tuple[Any, Any]:
    """Return scale and shift of a lower bound on the squared speed; a bound of zero is always satisfied."""
    return namespace(square).where(square > 0, square, 1.0), 2 * square


def value_of(usage: Any, name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the value of a limited quantity from its ratio to the limit, or from the value of an imposed function."""
    if name == SLOWEST:
        xp, (scale, shift) = namespace(usage, bounds[name]), _of_slowest(bounds[name] ** 2)
        return xp.sqrt(xp.maximum(shift - usage * scale, 0.0))
    if formula_limits.is_formula(name):
        return formula_limits.value_of(usage, name, bounds)
    if name in SIDES_OF_RATES:
        return quantity(name).side * usage * scale_and_shift(name, bounds)[0]
    return value_at(usage, name, bounds) if name in SIDED else _product(usage, bounds[name])


def _product(usage: Any, bound: Any) -> Any:
    """Return the value of a quantity from its ratio to the limit; NaN where no limit applies, so the ratio is zero."""
    xp = namespace(usage, bound)
    limited = xp.isfinite(bound)
    return xp.where(limited, usage * xp.where(limited, bound, 1.0), xp.nan)


def excludes_zero(bounds: Mapping[str, Scalar]) -> bool:
    """Return whether a limit on an acceleration is known not to allow zero: then the fastest timing must accelerate."""
    sided = [name for name in bounds if name in SIDED and name != SLOWEST]
    return any((quantity(name).side * all_values(bounds[name]) < 0).any() for name in sided)
