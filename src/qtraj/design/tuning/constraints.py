"""The limits as constraints at instants of a path.

A constraint is g(z, u) = ln(value/limit) ≤ 0, where z are the variables and u is the time divided by the duration T.
For a lower bound on a quantity that is never negative, the ratio is limit/value. A quantity that can be negative has a
large negative constraint value where it is negative. The value for an obstacle is that of `clearances`. The registry's
formulas are evaluated for the derivatives with respect to u, in units of a length L of the problem. So T enters only as
−p·ln T, where p is the power of 1/s in the unit of the quantity, and in the gravity of forces. The arithmetic is
NumPy's, JAX's, or that of jets.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.jets import cos, exp, log, replaced, sin, sqrt
from qtraj.algebra.polynomial import taylor_terms
from qtraj.algebra.sparse import mul
from qtraj.design.one_sided import scale_and_shift
from qtraj.design.timing.speed_ratio import SpeedEllipse, WithSpeed
from qtraj.design.tuning import clearances
from qtraj.design.tuning.clearances import Clearances
from qtraj.design.tuning.problem import Formulas
from qtraj.foundation.arrays import concrete
from qtraj.path.clearance_quantity import CLEARANCE
from qtraj.path.components import rotated_z
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import in_moving_basis
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import CORRIDOR, Offset, quantity

ABSENT, TOO_MUCH = -1e3, 1e3
"""The constraint values of a quantity that is zero or negative, and of a quantity that is infinite."""


MARGIN = 4e-9
"""The largest margin of limits on heights, in the middle of a path; other limits have theirs in `targets`."""


class Place(NamedTuple):
    """Taylor coefficients of ρ, φ and h in u at instants, from order 0 upwards; identically zero ones are 0."""

    radius: Sequence[Any]
    angle: Sequence[Any]
    height: Sequence[Any]


class Units(NamedTuple):
    """The data of a problem, or of each of many problems, that turn invariants into constraint values.

    `length` is L [m], `log_duration` is ln T, `up` is the vertical in the axes of the placement, or None if it is the
    third axis, and `reference` contains the cubics of the initial path. `road` contains the parameters of the vehicle.
    `limits` are the limits in the order of the names. `axes` are the origin and the axes of the placement in the world,
    which only obstacles need. `base` is the height of the origin of the placement [m], or None if no limit contains the
    position.
    """

    length: Any
    log_duration: Any
    up: tuple[Any, Any, Any] | None
    road: Any
    reference: tuple[Sequence[Any], Sequence[Any], Sequence[Any]]
    limits: Mapping[str, Any]
    clearances: Clearances | None = None
    axes: tuple[Any, ...] | None = None
    base: Any = None


@dataclass(frozen=True)
class _Entry:
    """The properties of a quantity, computed once."""

    entry: PathQuantity
    length: int
    per_time: int
    is_clearance: bool


@cache
def _entry(name: str) -> _Entry:
    entry = quantity(name)
    return _Entry(entry, entry.length, entry.per_time, entry is CLEARANCE)


def units(problem: Formulas, z: Any, limits: Mapping[str, Any], level: bool) -> Units:
    """Return the data of a problem for the variables `z`; `level` is true if the vertical is the third axis."""
    up = None if level else tuple(problem.vertical[..., k] for k in range(3))
    duration = log(problem.duration)
    if not problem.objective.fixes_duration:
        duration = z[problem.size - 1] + duration
    length = problem.speed * problem.duration
    own, road, reference = problem.clearances, problem.road, problem.cubics(problem.zero)
    axes = None if own is None else clearances.axes_of(problem.placement)
    base = problem.placement.origin[..., 2] if any(quantity(name).position for name in limits) else None
    return Units(length, duration, up, road, reference, limits, own, axes, base)  # type: ignore[arg-type]


def order_of(names: Sequence[str]) -> int:
    """Return the highest order of derivatives in the formulas of the limits."""
    return max(quantity(name).order for name in names)


def place(cubics: tuple[Sequence[Any], ...], u: Any, order: int) -> Place:
    """Return the Taylor coefficients at `u` of a path with the given coefficients of ρ, φ and h."""
    radius, angle, height = (taylor_terms(c, u, order) for c in cubics)
    return Place(radius, angle, height)


def invariants(at: Place, by: Units) -> Invariants:
    """Return the invariants of the derivatives with respect to u, in units of the length L."""
    inverse = 1 / by.length
    x, z = ([mul(c, inverse) for c in series] for series in (at.radius, at.height))
    r = in_moving_basis(x, [0] * len(x), z, at.angle)
    road, up = by.road, None
    if road is not None:
        gravity = exp(by.log_duration * 2.0) * (road.gravity * inverse)
        road = road._replace(gravity=gravity, drag=road.drag * by.length, wheelbase=road.wheelbase * inverse)
    if by.up is not None:
        angle = at.angle[0]
        up = rotated_z(by.up, cos(angle), -sin(angle))
    if by.base is not None:
        r[0] = _with_height(r[0], up, by.base * inverse)
    return Invariants(r, up, road, sqrt)


def _with_height(position: Any, up: Any, base: Any) -> Any:
    """Return a vector from the origin of the placement, moved vertically by the height `base` of this origin."""
    x, y, z = position
    return (x, y, z + base) if up is None else (x + up[0] * base, y + up[1] * base, z + up[2] * base)


def value(name: str, at: Place, i: Invariants, by: Units, u: Any) -> Any:
    """Return the constraint value g of one limit, from the Taylor coefficients and the invariants at `u`."""
    own = _entry(name)
    if own.is_clearance:
        return clearances.value(name, at, by, u)
    if name == CORRIDOR.name:
        return _log_ratio(_squared_distance(at, by, u), None) * 0.5 - log(by.limits[name])
    entry = own.entry
    if entry.of_position:
        return _limit_value(own, i, by) + (4 * MARGIN) * (u * (1.0 - u))
    return _limit_value(own, i, by)


def _limit_value(own: _Entry, i: Invariants, by: Units) -> Any:
    """Return the constraint value of a limit on a quantity."""
    entry, name = own.entry, own.entry.name
    if isinstance(by.limits[name], WithSpeed):
        return _value_by_speed(own, i, by)
    if entry.bounds_side:
        return _side_value(own, i, by)
    g = _log_ratio(entry.numerator(i), None if entry.denominator is None else entry.denominator(i))
    g = g if entry.signed else g * 0.5
    if entry.infinite is not None:
        g = replaced(g, entry.infinite(i), TOO_MUCH)
    constant = own.length * log(by.length) - log(by.limits[name])
    g = g + (constant if own.per_time == 0 else constant - by.log_duration * float(own.per_time))
    return -g if entry.lower else g


def _value_by_speed(own: _Entry, i: Invariants, by: Units) -> Any:
    """Return the constraint value of a limit on an acceleration that depends on the speed."""
    entry, limit = own.entry, by.limits[own.entry.name]
    unit = log(by.length) - by.log_duration * 2.0
    square = i.S * (exp(by.log_duration * -2.0) * (by.length * by.length))
    if isinstance(limit, SpeedEllipse):
        return _log_ratio(limit.square(i, square), None) * 0.5 + unit
    above = entry.side * entry.numerator(i) if entry.bounds_side else entry.numerator(i)
    g = _log_ratio(above, None if entry.denominator is None else entry.denominator(i))
    return (g if entry.signed else g * 0.5) + unit - log(limit.at(square))


def _side_value(own: _Entry, i: Invariants, by: Units) -> Any:
    """Return the constraint value ln((x + s)/(b + s)) of a limit on one side of a signed value (see `one_sided`)."""
    entry = own.entry
    scale, shift = scale_and_shift(entry.name, by.limits)
    numerator = entry.side * entry.numerator(i)
    denominator = None if entry.denominator is None else entry.denominator(i)
    unit = own.length * log(by.length)
    unit = unit if own.per_time == 0 else unit - by.log_duration * float(own.per_time)
    if concrete(shift) is not None and not np.any(shift):
        return _log_ratio(numerator, denominator) + unit - log(scale)
    shifted = numerator * exp(unit) + (shift if denominator is None else shift * denominator)
    return _log_ratio(shifted, denominator) - log(scale)


def _squared_distance(at: Place, by: Units, u: Any) -> Any:
    """Return the squared distance from the initial path at the same fraction of the duration."""
    radius, angle, height = (taylor_terms(c, u, 0)[0] for c in by.reference)
    offset = Offset(at.radius[0] - radius, at.angle[0] - angle, at.height[0] - height, radius)
    return CORRIDOR.numerator(offset)


def _log_ratio(numerator: Any, denominator: Any) -> Any:
    """Return ln(numerator/denominator); the ratio 0/0 counts as 0, and a positive number divided by 0 as infinite."""
    above = log(numerator, 3 * ABSENT)
    return above if denominator is None else above - log(denominator, -TOO_MUCH)
