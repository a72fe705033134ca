"""Registry of path quantities, which can be evaluated along a path and limited.

Each entry consists of the name, symbol, unit and meaning of a quantity, the order of the highest derivative in its
formula, and a ratio of polynomials in the invariants of `frenet` (see `PathQuantity`). `Limits`, scenarios, tables,
datasets, figures, proofs and tuning use this registry.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

from qtraj.algebra.cpu import inverse_root
from qtraj.foundation.argument import require_type
from qtraj.path.clearance_quantity import CLEARANCE, names_obstacle
from qtraj.path.combined_quantity import COMBINED, COMBINED_QUANTITY
from qtraj.path.frenet import binormal_numerator, natural_acceleration, tangential_numerator, yaw
from qtraj.path.gravity_quantities import GRAVITY_QUANTITIES
from qtraj.path.moment_quantities import MOMENT_QUANTITIES
from qtraj.path.motion_quantities import MOTION_QUANTITIES
from qtraj.path.own_name import OwnName
from qtraj.path.path_quantity import Component, PathQuantity, cubed, quotient, ratio, squared
from qtraj.path.road_quantities import ROAD_QUANTITIES
from qtraj.path.sides import LOWER, sides_of, upper_side
from qtraj.path.steering_quantities import STEERING_QUANTITIES


def _rate_square(i: Any) -> Any:
    return i.S * ratio(squared(i.T), squared(i.N)) + ratio(i.N, squared(i.S))


def _acceleration_square(i: Any) -> Any:
    """Return the squared angular acceleration of the natural trihedral, or zero where the trihedral does not exist."""
    inv_speed, inv_cross_norm = (inverse_root(x) for x in (i.S, i.N))
    along, across = natural_acceleration(i, inv_speed, inv_cross_norm, i.T * inv_cross_norm**2)
    return squared(along) + squared(across)


def _yaw_acceleration_square(i: Any) -> Any:
    return squared(yaw(i, inverse_root(i.S), inverse_root(i.H))[1])


def _acceleration_numerator(i: Any) -> Any:
    """Return S⁴N⁴ times the squared angular acceleration of the trihedral, with S = |r'|² and N = |r' × r''|²."""
    return cubed(i.S) * squared(tangential_numerator(i)) + cubed(i.N) * squared(binormal_numerator(i))


def _yaw_acceleration_numerator(i: Any) -> Any:
    """Return (SH)³ times the squared yaw acceleration ω̇_z of the upright frame.

    ω̇_z = (P'SH − P(BH + SG))/√(SH)³ is the derivative of the yaw rate ω_z = P/√(SH), with the invariants S, H, P, B
    and G of `frenet.Invariants`.
    """
    return squared(_yaw_growth(i))


def _yaw_growth(i: Any) -> Any:
    """Return √(SH)³ times the yaw acceleration (see `_yaw_acceleration_numerator`)."""
    return i.P1 * (i.S * i.H) - i.P * (i.B * i.H + i.S * i.G)


_ENTRIES = (
    PathQuantity(
        "curvature",
        "κ",
        "m-1",
        2,
        "curvature of the path",
        numerator=lambda i: i.N,
        denominator=lambda i: cubed(i.S),
        divisor="speed",
    ),
    PathQuantity(
        "torsion",
        "|χ|",
        "m-1",
        3,
        "magnitude of the torsion",
        numerator=lambda i: squared(i.T),
        denominator=lambda i: squared(i.N),
        divisor="cross_norm",
        output="torsion_magnitude",
        component=Component(
            "torsion, positive where the path turns about its tangent like a right-handed screw",
            numerator=lambda i: i.T,
            denominator=lambda i: i.N,
            value=lambda i: i.T * inverse_root(i.N) ** 2,
        ),
    ),
    PathQuantity("speed", "v", "m s-1", 1, "speed", numerator=lambda i: i.S, bounds_speed=True),
    PathQuantity(
        "acceleration",
        "|r̈|",
        "m s-2",
        2,
        "magnitude of the acceleration",
        numerator=lambda i: i.A,
        output="acceleration_magnitude",
        bounds_speed=True,
    ),
    PathQuantity(
        "lateral_acceleration",
        "a_n",
        "m s-2",
        2,
        "normal acceleration, |r' × r''| / |r'|",
        numerator=lambda i: i.N,
        denominator=lambda i: i.S,
        divisor="speed",
        bounds_speed=True,
    ),
    PathQuantity(
        "longitudinal_acceleration",
        "|a_τ|",
        "m s-2",
        2,
        "magnitude of the tangential acceleration, |r' · r''| / |r'|",
        numerator=lambda i: squared(i.B),
        denominator=lambda i: i.S,
        divisor="speed",
        output="longitudinal_acceleration_magnitude",
        component=Component(
            "tangential acceleration, r' · r'' / |r'|; negative while braking",
            numerator=lambda i: i.B,
            denominator=lambda i: i.v,
            value=lambda i: i.B * inverse_root(i.S),
        ),
    ),
    PathQuantity(
        "slope",
        "s",
        "1",
        1,
        "magnitude of the slope, rise over run, relative to the horizontal plane",
        numerator=lambda i: squared(i.V),
        denominator=lambda i: i.H,
        divisor="speed",
        upright=True,
        output="slope_magnitude",
        component=Component(
            "slope, rise over run relative to the horizontal plane; positive uphill",
            numerator=lambda i: i.V,
            denominator=lambda i: i.h,
            value=lambda i: quotient(i.V, i.H),
        ),
    ),
    PathQuantity(
        "angular_rate",
        "|ω⁰|",
        "rad s-1",
        3,
        "magnitude of the natural trihedral's angular rate",
        numerator=lambda i: i.S * squared(i.S * i.T) + cubed(i.N),
        denominator=lambda i: squared(i.N * i.S),
        divisor="cross_norm",
        square=_rate_square,
        of="natural trihedral",
        bounds_speed=True,
    ),
    PathQuantity(
        "angular_acceleration",
        "|ε⁰|",
        "rad s-2",
        4,
        "magnitude of the natural trihedral's angular acceleration",
        numerator=_acceleration_numerator,
        denominator=lambda i: squared(squared(i.S)) * squared(squared(i.N)),
        divisor="cross_norm",
        square=_acceleration_square,
        of="natural trihedral",
        output="angular_acceleration_magnitude",
    ),
    PathQuantity("jerk", "|r⃛|", "m s-3", 3, "magnitude of the jerk", numerator=lambda i: i.J, output="jerk_magnitude"),
    PathQuantity(
        "yaw_rate",
        "|ω_z|",
        "rad s-1",
        2,
        "magnitude of the upright frame's angular rate about its own z axis",
        numerator=lambda i: squared(i.P),
        denominator=lambda i: i.S * i.H,
        divisor="level",
        upright=True,
        bounds_speed=True,
        output="yaw_rate_magnitude",
        component=Component(
            "angular rate of the upright frame about its own z axis; positive in left turns",
            numerator=lambda i: i.P,
            denominator=lambda i: i.v * i.h,
            value=lambda i: i.P * inverse_root(i.S) * inverse_root(i.H),
        ),
    ),
    PathQuantity(
        "yaw_acceleration",
        "|ε_z|",
        "rad s-2",
        3,
        "magnitude of the upright frame's angular acceleration about its own z axis",
        numerator=_yaw_acceleration_numerator,
        denominator=lambda i: cubed(i.S * i.H),
        square=_yaw_acceleration_square,
        divisor="level",
        upright=True,
        output="yaw_acceleration_magnitude",
        component=Component(
            "angular acceleration of the upright frame about its own z axis; positive to the left",
            numerator=_yaw_growth,
            denominator=lambda i: i.S * i.H * (i.v * i.h),
            value=lambda i: yaw(i, inverse_root(i.S), inverse_root(i.H))[1],
        ),
    ),
)

QUANTITIES: dict[str, PathQuantity] = {
    entry.name: entry
    for entry in (
        *_ENTRIES,
        *MOTION_QUANTITIES,
        *GRAVITY_QUANTITIES,
        *STEERING_QUANTITIES,
        *ROAD_QUANTITIES,
        *MOMENT_QUANTITIES,
    )
}
"""The quantities by their names in `Limits`, in display order."""

SIDES = sides_of(QUANTITIES.values())
"""The sides of limits that bound signed values (see `sides`), by name."""

TITLES = {entry.variable: entry.title for entry in (*SIDES.values(), *QUANTITIES.values())}
"""The titles of the quantities in figures and reports, by the names of the outputs."""


class Offset(NamedTuple):
    """Difference of a path from a reference path about the same axis, at equal fractions of their durations.

    Let ρ, φ and h be radius, azimuth and height of the path, and ρ₀, φ₀ and h₀ of the reference. Then `outwards` is ρ −
    ρ₀, `angle` is φ − φ₀, `up` is h − h₀, and `radius` is ρ₀. The numbers are of any numeric type.
    """

    outwards: Any
    angle: Any
    up: Any
    radius: Any


CORRIDOR = PathQuantity(
    "corridor",
    "d",
    "m",
    0,
    "distance between the two paths at the same fraction of their durations; the azimuth difference enters as an "
    "arc length: d² = Δρ² + ρ₁ρ₂Δφ² + Δh²",
    numerator=lambda p: (
        p.outwards * p.outwards + (p.outwards + p.radius) * p.radius * (p.angle * p.angle) + p.up * p.up
    ),
)
"""The distance d of two paths; the formula uses their `Offset` instead of invariants.

With the symbols of `Offset`, the square d² = (ρ − ρ₀)² + ρρ₀(φ − φ₀)² + (h − h₀)² is a polynomial. For positive radii,
d is at least the distance between the paths, because a chord is shorter than its arc.
"""


def bound_speed(names: Collection[str]) -> bool:
    """Return whether limits with these names bound the speed on every path; a pair does if a number does."""
    bounding = [entry for entry in (*QUANTITIES.values(), COMBINED_QUANTITY) if entry.bounds_speed]
    return any(x.name in names or {x.name + LOWER, upper_side(x)} <= set(names) for x in bounding)


_KNOWN = QUANTITIES | SIDES | {CORRIDOR.name: CORRIDOR, COMBINED: COMBINED_QUANTITY}
"""All quantities and sides of limits by name."""


LIMITED = (*QUANTITIES, COMBINED)
"""The names of the fields of `Limits`."""


def quantity(name: str) -> PathQuantity:
    """Return the path quantity, or the side of a limit, with this name; an `OwnName` carries its entry.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(name, OwnName):
        return name.entry
    require_type(name, str, "the name of a path quantity", "a string such as 'curvature'")
    if name in _KNOWN:
        return _KNOWN[name]
    if names_obstacle(name):
        return CLEARANCE
    known = ", ".join((*QUANTITIES, CORRIDOR.name))
    raise ValueError(
        f"unknown path quantity {name!r}; the known quantities are {known}, and the sides "
        "of two-sided limits, with the endings _min and _max"
    )
