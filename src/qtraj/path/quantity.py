"""The registry of path quantities: what can be limited, evaluated, proved and tuned along a path.

One entry says all of a quantity: name, symbol, unit, the highest derivative it needs, its square as a ratio of
polynomials in the invariants of `frenet`, and its meaning. `Limits`, scenarios, tables, datasets, figures, proofs and
tuning read it.
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
"""What is formed from `Invariants`, over any arithmetic."""


class Division(NamedTuple):
    """How numbers are divided: part/whole and 1/√x of positive numbers."""

    quotient: Callable[[Any, Any], Any]
    inverse_root: Callable[[Any], Any]


PLAIN = Division(lambda part, whole: part / whole, lambda x: x**-0.5)


@dataclass(frozen=True)
class PathQuantity:
    """A quantity along a path that is not negative: its square is numerator/denominator.

    `divisor` is what must not vanish for the quantity to exist: "speed" (S), "cross_norm" (N) or "level" (H). `square`
    is a second form of the same ratio for numbers, where the first would overflow or lose digits. `output` is the
    name in tables and datasets, where a vector may bear the quantity's own name. `bounds_speed`: a limit on it keeps
    any path from being driven arbitrarily fast.
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
        """Its name among the outputs of an evaluation."""
        return self.output or self.name

    @property
    def label(self) -> str:
        """Its unit as people write it; "-" for a number without unit."""
        return units.symbol(self.unit) or "-"

    @property
    def length(self) -> int:
        """The power of metres in its unit."""
        return units.powers(self.unit).get("m", 0)

    @property
    def per_time(self) -> int:
        """The power of 1/s in its unit."""
        return units.per_time(self.unit)

    def squared(self, i: Any, by: Division = PLAIN) -> Any:
        """Its square in numbers, of one instant or of many; infinite where it grows without bound."""
        if self.square is not None:
            return self.square(i, by)
        part = self.numerator(i)
        return part if self.denominator is None else ratio(part, self.denominator(i), by)


def ratio(part: Any, whole: Any, by: Division = PLAIN) -> Any:
    """part/whole of numbers; 0/0 is 0 and anything else over 0 infinite, with zero gradient. NaN stays NaN."""
    return _ratio(jnp.asarray(part), jnp.asarray(whole), by)


@partial(jax.jit, static_argnames="by")
def _ratio(part: Any, whole: Any, by: Division) -> Any:
    vanishes = whole <= 0
    found = by.quotient(part, jnp.where(vanishes, 1.0, whole))
    return jnp.where(vanishes, jnp.where(part > 0, jnp.inf, 0.0 * part), found)


def _square(x: Any) -> Any:
    return x * x


def _cube(x: Any) -> Any:
    return x * (x * x)


def _rate_square(i: Any, by: Division) -> Any:
    return i.S * ratio(_square(i.T), _square(i.N), by) + ratio(i.N, _square(i.S), by)


def _acceleration_square(i: Any, by: Division) -> Any:
    """|ε⁰|² in numbers; zero where the trihedral does not exist."""
    inv_speed, inv_cross_norm = (_inverse_root(x, by) for x in (i.S, i.N))
    along, across = natural_acceleration(i, inv_speed, inv_cross_norm, i.T * inv_cross_norm**2)
    return _square(along) + _square(across)


def _yaw_acceleration_square(i: Any, by: Division) -> Any:
    return _square(yaw(i, _inverse_root(i.S, by), _inverse_root(i.H, by))[1])


@partial(jax.jit, static_argnames="by")
def _inverse_root(x: Any, by: Division) -> Any:
    vanishes = x <= 0
    return jnp.where(vanishes, 0.0, by.inverse_root(jnp.where(vanishes, 1.0, x)))


def _acceleration_numerator(i: Any) -> Any:
    """ε⁰ = (v'χ + vχ', 0, E/(|c|S) − 2|c|B/S²) with χ = T/N, squared, over S⁴N⁴."""
    along = i.B * (i.T * i.N) + i.S * (i.D * i.N - 2 * (i.T * i.E))
    across = i.E * i.S - 2 * (i.N * i.B)
    return _cube(i.S) * _square(along) + _cube(i.N) * _square(across)


def _yaw_acceleration_numerator(i: Any) -> Any:
    """ω_z = P/√(SH), and so ω̇_z = (P'SH − P(BH + SG))/√(SH)³: its square, over (SH)³."""
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
        "acceleration across the path, |r' × r''| / |r'|",
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
        "magnitude of the acceleration along the path, |r' · r''| / |r'|",
        numerator=lambda i: _square(i.B),
        denominator=lambda i: i.S,
        divisor="speed",
    ),
    PathQuantity(
        "slope",
        "s",
        "1",
        1,
        "magnitude of rise over run, against the world's z axis",
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
"""By the names of `Limits`; their order here is the order everywhere."""


class Offset(NamedTuple):
    """How far a path is from another, its reference, at equal parts of the durations, about one axis.

    `outwards` ρ − ρ₀, `angle` φ − φ₀, `up` h − h₀, and the `radius` ρ₀ of the reference; over any arithmetic.
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
    "distance from the given path at equal parts of the durations, counted along the arc",
    numerator=lambda p: (
        p.outwards * p.outwards + (p.outwards + p.radius) * p.radius * (p.angle * p.angle) + p.up * p.up
    ),
)
"""A quantity of two paths, whose `Offset` takes the place of the invariants. Where both radii are positive the square,
(ρ − ρ₀)² + ρρ₀(φ − φ₀)² + (h − h₀)², is a polynomial and no smaller than that of the distance, whose chord is shorter
than the arc."""


def quantity(name: str) -> PathQuantity:
    """The entry of this name.

    **Raises:** ValueError for an unknown name.
    """
    known = QUANTITIES | {CORRIDOR.name: CORRIDOR}
    if name not in known:
        raise ValueError(f"unknown path quantity {name!r}; known are {', '.join(known)}")
    return known[name]
