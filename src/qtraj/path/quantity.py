"""The registry of path quantities: everything that can be limited, evaluated, certified and tuned along a path.

An entry has the name, symbol, unit and meaning of a quantity, the highest derivative that it needs, and its square as a
ratio of polynomials in the invariants of `frenet`. `Limits`, scenarios, tables, datasets, figures, proofs and tuning
use this registry.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from qtraj.foundation import units
from qtraj.path.frenet import natural_acceleration, yaw

Formula = Callable[[Any], Any]
"""A function of `Invariants`, for any numeric type."""


class Division(NamedTuple):
    """A way to divide numbers: the quotient of two, and 1/√x, both for positive divisors."""

    quotient: Callable[[Any, Any], Any]
    inverse_root: Callable[[Any], Any]


PLAIN = Division(lambda numerator, denominator: numerator / denominator, lambda x: x**-0.5)


@dataclass(frozen=True)
class PathQuantity:
    """A nonnegative quantity along a path, whose square is numerator/denominator.

    The quantity exists where `divisor` is not zero: "speed" (S), "cross_norm" (N) or "level" (H). `square` is another
    form of the same ratio for floating-point numbers, used where numerator and denominator would overflow or lose
    digits. `output` is the name in tables and datasets, if a vector already has the quantity's name. `bounds_speed`: a
    limit on the quantity also bounds the speed on every path.
    """

    name: str
    symbol: str
    unit: str
    order: int
    meaning: str
    numerator: Formula
    denominator: Formula | None = None
    divisor: str | None = None
    square: Callable[[Any, Division], Any] | None = None
    output: str = ""
    upright: bool = False
    bounds_speed: bool = False

    @property
    def variable(self) -> str:
        """The name of the quantity as an output of `qtraj.evaluate`."""
        return self.output or self.name

    @property
    def label(self) -> str:
        """The unit as it is displayed; "-" for a dimensionless number."""
        return units.symbol(self.unit) or "-"

    @property
    def length(self) -> int:
        """The exponent of metres in the unit."""
        return units.powers(self.unit).get("m", 0)

    @property
    def per_time(self) -> int:
        """The exponent of 1/s in the unit."""
        return units.per_time(self.unit)

    def squared(self, i: Any, by: Division = PLAIN) -> Any:
        """The squared quantity in floating point, at one instant or an array of instants; `inf` at a pole."""
        if self.square is not None:
            return self.square(i, by)
        numerator = self.numerator(i)
        return numerator if self.denominator is None else ratio(numerator, self.denominator(i), by)


def ratio(numerator: Any, denominator: Any, by: Division = PLAIN) -> Any:
    """The quotient; 0/0 is 0, and other quotients by 0 are infinite, with zero gradient. NaN stays NaN."""
    return _ratio(jnp.asarray(numerator), jnp.asarray(denominator), by)


@partial(jax.jit, static_argnames="by")
def _ratio(numerator: Any, denominator: Any, by: Division) -> Any:
    zero = denominator <= 0
    quotient = by.quotient(numerator, jnp.where(zero, 1.0, denominator))
    return jnp.where(zero, jnp.where(numerator > 0, jnp.inf, 0.0 * numerator), quotient)


def _square(x: Any) -> Any:
    return x * x


def _cube(x: Any) -> Any:
    return x * (x * x)


def _rate_square(i: Any, by: Division) -> Any:
    return i.S * ratio(_square(i.T), _square(i.N), by) + ratio(i.N, _square(i.S), by)


def _acceleration_square(i: Any, by: Division) -> Any:
    """|ε⁰|²; zero where the trihedral does not exist."""
    inv_speed, inv_cross_norm = (_inverse_root(x, by) for x in (i.S, i.N))
    along, across = natural_acceleration(i, inv_speed, inv_cross_norm, i.T * inv_cross_norm**2)
    return _square(along) + _square(across)


def _yaw_acceleration_square(i: Any, by: Division) -> Any:
    return _square(yaw(i, _inverse_root(i.S, by), _inverse_root(i.H, by))[1])


@partial(jax.jit, static_argnames="by")
def _inverse_root(x: Any, by: Division) -> Any:
    zero = x <= 0
    return jnp.where(zero, 0.0, by.inverse_root(jnp.where(zero, 1.0, x)))


def _acceleration_numerator(i: Any) -> Any:
    """The square of ε⁰ = (v'χ + vχ', 0, E/(|c|S) − 2|c|B/S²) with χ = T/N, times S⁴N⁴."""
    along = i.B * (i.T * i.N) + i.S * (i.D * i.N - 2 * (i.T * i.E))
    across = i.E * i.S - 2 * (i.N * i.B)
    return _cube(i.S) * _square(along) + _cube(i.N) * _square(across)


def _yaw_acceleration_numerator(i: Any) -> Any:
    """The square of ω̇_z = (P'SH − P(BH + SG))/√(SH)³, the derivative of ω_z = P/√(SH), times (SH)³."""
    return _square(i.P1 * (i.S * i.H) - i.P * (i.B * i.H + i.S * i.G))


_ENTRIES = (
    PathQuantity(
        "curvature",
        "κ",
        "m-1",
        2,
        "curvature of the path",
        numerator=lambda i: i.N,
        denominator=lambda i: _cube(i.S),
        divisor="speed",
    ),
    PathQuantity(
        "torsion",
        "|χ|",
        "m-1",
        3,
        "magnitude of the torsion",
        numerator=lambda i: _square(i.T),
        denominator=lambda i: _square(i.N),
        divisor="cross_norm",
        output="torsion_magnitude",
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
        numerator=lambda i: _square(i.B),
        denominator=lambda i: i.S,
        divisor="speed",
    ),
    PathQuantity(
        "slope",
        "s",
        "1",
        1,
        "magnitude of the slope, rise over run, relative to the horizontal plane",
        numerator=lambda i: _square(i.V),
        denominator=lambda i: i.H,
        divisor="speed",
        upright=True,
    ),
    PathQuantity(
        "angular_rate",
        "|ω⁰|",
        "rad s-1",
        3,
        "magnitude of the natural trihedral's angular rate",
        numerator=lambda i: i.S * _square(i.S * i.T) + _cube(i.N),
        denominator=lambda i: _square(i.N * i.S),
        divisor="cross_norm",
        square=_rate_square,
        bounds_speed=True,
    ),
    PathQuantity(
        "angular_acceleration",
        "|ε⁰|",
        "rad s-2",
        4,
        "magnitude of the natural trihedral's angular acceleration",
        numerator=_acceleration_numerator,
        denominator=lambda i: _square(_square(i.S)) * _square(_square(i.N)),
        divisor="cross_norm",
        square=_acceleration_square,
        output="angular_acceleration_magnitude",
    ),
    PathQuantity("jerk", "|r⃛|", "m s-3", 3, "magnitude of the jerk", numerator=lambda i: i.J, output="jerk_magnitude"),
    PathQuantity(
        "yaw_rate",
        "|ω_z|",
        "rad s-1",
        2,
        "magnitude of the upright frame's angular rate about its own z axis",
        numerator=lambda i: _square(i.P),
        denominator=lambda i: i.S * i.H,
        divisor="level",
        upright=True,
        bounds_speed=True,
    ),
    PathQuantity(
        "yaw_acceleration",
        "|ε_z|",
        "rad s-2",
        3,
        "magnitude of the upright frame's angular acceleration about its own z axis",
        numerator=_yaw_acceleration_numerator,
        denominator=lambda i: _cube(i.S * i.H),
        square=_yaw_acceleration_square,
        divisor="level",
        upright=True,
    ),
)

QUANTITIES: dict[str, PathQuantity] = {entry.name: entry for entry in _ENTRIES}
"""The quantities by their names in `Limits`, in the order in which they are displayed."""


class Offset(NamedTuple):
    """The difference of a path from a reference path about the same axis, at equal fractions of their durations.

    `outwards` ρ − ρ₀, `angle` φ − φ₀, `up` h − h₀, and the `radius` ρ₀ of the reference, in any numeric type.
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
    "distance between the two paths at the same fraction of their durations; the angle about the axis counts by its "
    "arc length: d² = Δρ² + ρ₁ρ₂Δφ² + Δh²",
    numerator=lambda p: (
        p.outwards * p.outwards + (p.outwards + p.radius) * p.radius * (p.angle * p.angle) + p.up * p.up
    ),
)
"""A quantity of two paths; its formula uses their `Offset` instead of invariants. The square,
(ρ − ρ₀)² + ρρ₀(φ − φ₀)² + (h − h₀)², is a polynomial. For positive radii it is at least the squared distance, because
the chord is shorter than the arc."""


def quantity(name: str) -> PathQuantity:
    """The path quantity with this name.

    **Raises:** ValueError for an unknown name.
    """
    entries = QUANTITIES | {CORRIDOR.name: CORRIDOR}
    if name not in entries:
        raise ValueError(f"unknown path quantity {name!r}; the known quantities are {', '.join(entries)}")
    return entries[name]
