"""The units of a proof: those of a `Source`, or SI units for formulas with numbers that have a unit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.sparse import is_one, mul
from qtraj.design.proof.sources import Derivatives, Source
from qtraj.path.road_on_path import LINEAR
from qtraj.path.road_parameters import RoadParameters


def scaled_vehicle(vehicle: RoadParameters, source: Source) -> RoadParameters:
    """Return the parameters of the vehicle in the units of `source`."""
    h, length = source.duration, source.length
    return vehicle._replace(
        gravity=vehicle.gravity * h * h / length, drag=vehicle.drag * length, wheelbase=vehicle.wheelbase / length
    )


def unit_of_time(source: Source, span: Any, k: int) -> float:
    """Return the unit of time [s] of the derivatives of path k, whose variable runs from 0 to `span`."""
    return float(source.duration[k]) if is_one(span) else 1.0


def constants(
    vehicle: RoadParameters,
    constant: Callable[[Any], Any],
    end: RoadParameters | None = None,
    fraction: Any = None,
) -> RoadParameters:
    """Return the parameters as constant polynomials; a parameter that is 0 or 1 for all paths is that integer.

    With the parameters at the `end`, those that change are linear in the polynomial `fraction`.
    """

    def of(x: np.ndarray, y: np.ndarray) -> Any:
        if np.isnan(x).any():  # it changes along a road: claims that use it are not decided
            return _unknown(constant, x)
        if (x != y).any():
            return constant(x) + (constant(y) - constant(x)) * fraction
        return int(np.ravel(x)[0]) if np.all(x == 0) or np.all(x == 1) else constant(x)

    pairs = zip(vehicle.numbers, _other_end(vehicle, end).numbers, strict=True)
    return RoadParameters(*(of(np.asarray(x, float), np.asarray(y, float)) for x, y in pairs))


def _unknown(constant: Callable[[Any], Any], x: np.ndarray) -> Any:
    try:
        return constant(x)
    except ValueError:  # integers cannot be NaN; a claim that uses this number raises a ValueError, too
        return np.nan


def vehicle_at(vehicle: RoadParameters | None, end: RoadParameters | None, u: np.ndarray) -> RoadParameters | None:
    """Return the parameters at fractions `u` (k, n) of the way to the `end`."""
    if vehicle is None or end is None:
        return vehicle
    changed = {name: x + u * (getattr(end, name) - x) for name in LINEAR for x in [getattr(vehicle, name)]}
    return vehicle._replace(**changed)


def _other_end(vehicle: RoadParameters, end: RoadParameters | None) -> RoadParameters:
    return vehicle if end is None else vehicle._replace(**{name: getattr(end, name) for name in LINEAR})


def bounded_in_si(d: Derivatives, source: Source) -> Derivatives:
    """Return bounded derivatives of all paths in SI units."""
    return _in_si(d, lambda k: BoundedPolynomial.constant(source.length / source.duration**k, k=2 * k + 4))


def values_in_si(d: Derivatives, source: Source) -> Derivatives:
    """Return derivatives that are numbers in SI units."""
    return _in_si(d, lambda k: source.length / source.duration**k)


def _in_si(d: Derivatives, unit: Callable[[int], Any]) -> Derivatives:
    rows = [None if row is None else tuple(mul(x, unit(k)) for x in row) for k, row in enumerate(d.rows)]
    return d._replace(rows=rows)


def times_power(x: Any, base: float, exponent: int) -> Any:
    """Return x·base^exponent, exactly."""
    factor = ExactPolynomial.of(base)
    for _ in range(exponent):
        x = x * factor
    return x


def as_number(x: Any) -> float:
    """Return a number as a float; infinite after an overflow."""
    try:
        return float(x)
    except OverflowError:
        return np.inf
