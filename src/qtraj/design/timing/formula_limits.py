"""How limits on formulas of the motion are imposed by `formulas`, and what a search must know about them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from qtraj.design.one_sided import stricter, value_at
from qtraj.design.timing.road import POWER_SIDES
from qtraj.design.varying import all_values
from qtraj.path.own_facts import rate_degree
from qtraj.path.own_name import OwnName
from qtraj.path.quantity import quantity

UPPER_BOUND, SIGNED, SQUARE, LOWER_SQUARE = "upper bound", "signed", "square", "lower square"
"""How a limit is imposed: as an upper bound on a, on the value, on its square, and as a lower bound on its square."""


def is_formula(name: str) -> bool:
    """Return whether a limit is imposed as described in `formulas`."""
    return isinstance(name, OwnName) or name in POWER_SIDES


def own_names(bounds: Collection[str]) -> tuple[str, ...]:
    """Return the names of own quantities in `bounds`, in the order in which JAX sorts the keys of a dictionary."""
    return tuple(sorted(name for name in bounds if isinstance(name, OwnName)))


def kind_of(name: str, bound: Any) -> str:
    """Return how a limit is imposed."""
    entry = quantity(name)
    if rate_degree(entry) and (not entry.base or (entry.side * all_values(bound) > 0).all()):
        return UPPER_BOUND
    if entry.signed is not None:
        return SIGNED
    return LOWER_SQUARE if entry.lower else SQUARE


def is_coupled(bounds: Mapping[str, Any]) -> bool:
    """Return whether a limit on a formula couples speed and acceleration, or is a lower bound."""
    return any(is_formula(name) and kind_of(name, x) != UPPER_BOUND for name, x in bounds.items())


def of_third_order(bounds: Collection[str]) -> bool:
    """Return whether the limits contain the third derivative of the motion."""
    return "jerk" in bounds or any(isinstance(name, OwnName) and quantity(name).order > 2 for name in bounds)


def is_jerk(name: str) -> bool:
    """Return whether a limit is on the jerk, or on an own quantity in its unit."""
    return name == "jerk" or (isinstance(name, OwnName) and quantity(name).unit == quantity("jerk").unit)


def reduced(name: str, bounds: Mapping[str, Any], fraction: float) -> Any:
    """Return the limit on a formula, stricter by `fraction`."""
    kind = kind_of(name, bounds[name])
    if kind == SIGNED:
        return stricter(name, bounds, fraction)
    return bounds[name] * (1 + fraction if kind == LOWER_SQUARE else 1 - fraction)


def value_of(usage: Any, name: str, bounds: Mapping[str, Any]) -> Any:
    """Return the value of a formula from the result of `Formulas.used`."""
    bound = bounds[name]
    if quantity(name).signed is not None:
        return value_at(usage, name, bounds)
    if kind_of(name, bound) == LOWER_SQUARE:
        scale, shift = of_lower(np.asarray(bound))
        return np.sqrt(np.maximum(shift - usage * scale, 0.0))
    return usage * bound


def exponent(name: str) -> float:
    """Return the exponent with which the quantity depends on a = u̇²."""
    return 0.5 * float(rate_degree(quantity(name)) or 2)


def of_lower(bound: np.ndarray) -> tuple[Any, Any]:
    """Return scale and shift of a lower bound on a square; a bound that is not positive is always satisfied."""
    square = np.maximum(bound, 0.0) ** 2
    return np.where(square > 0, square, 1.0), 2 * square
