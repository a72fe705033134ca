"""An entry of the registry of path quantities: its names, its unit, and its square as a ratio of polynomials."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from qtraj.foundation import units

Formula = Callable[[Any], Any]
"""A function of `Invariants`, for any numeric type."""


class Division(NamedTuple):
    """A way to divide numbers: the quotient of two, and 1/√x, both for positive divisors."""

    quotient: Callable[[Any, Any], Any]
    inverse_root: Callable[[Any], Any]


PLAIN = Division(lambda numerator, denominator: numerator / denominator, lambda x: x**-0.5)


LOAD = "load"
"""The divisor of friction: the load on the road."""


@dataclass(frozen=True)
class PathQuantity:
    """A nonnegative quantity along a path, whose square is numerator/denominator.

    The quantity exists where `divisor` is not zero: "speed" (S), "cross_norm" (N), "level" (H) or "load" (the
    force onto the road). `square` is another form of the same ratio for floating-point numbers, used where numerator
    and denominator would overflow or lose digits. `output` is the name in tables and datasets, if a vector already has
    the quantity's name. `bounds_speed`: a limit on the quantity also bounds the speed on every path. `needs_vehicle`:
    the formulas use `Invariants.vehicle`.

    A quantity with `signed` has either sign: numerator/denominator is the quantity itself, and `signed` the same in
    floating-point numbers. A limit bounds its positive values only, so its square is that of the positive part.
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
    signed: Callable[[Any, Division], Any] | None = None
    needs_vehicle: bool = False

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
        return units.base_powers(self.unit).get("m", 0)

    @property
    def per_time(self) -> int:
        """The exponent of 1/s in the unit."""
        return units.per_time(self.unit)

    def squared(self, i: Any, by: Division = PLAIN) -> Any:
        """The squared quantity in floating point, at one instant or an array of instants; `inf` at a pole."""
        if self.signed is not None:
            return squared(jnp.maximum(self.signed(i, by), 0.0))
        if self.square is not None:
            return self.square(i, by)
        numerator = self.numerator(i)
        return numerator if self.denominator is None else ratio(numerator, self.denominator(i), by)

    def value(self, i: Any, by: Division = PLAIN) -> Any:
        """The quantity in floating point, at one instant or an array of instants; `inf` at a pole."""
        return i.root(self.squared(i, by)) if self.signed is None else self.signed(i, by)

    def exceeds(self, i: Any, bound: Any) -> Any:
        """Whether the quantity is larger than a bound, without division."""
        if self.divisor == LOAD:
            return (self.numerator(i) > bound**2 * self.denominator(i)) | (i.onto < 0)  # type: ignore[misc]
        denominator = 1.0 if self.denominator is None else self.denominator(i)
        return self.numerator(i) > (bound if self.signed else bound**2) * denominator


def ratio(numerator: Any, denominator: Any, by: Division = PLAIN) -> Any:
    """The quotient; 0/0 is 0, and other quotients by 0 are infinite, with zero gradient. NaN stays NaN."""
    return _ratio(jnp.asarray(numerator), jnp.asarray(denominator), by)


@partial(jax.jit, static_argnames="by")
def _ratio(numerator: Any, denominator: Any, by: Division) -> Any:
    zero = denominator <= 0
    quotient = by.quotient(numerator, jnp.where(zero, 1.0, denominator))
    return jnp.where(zero, jnp.where(numerator > 0, jnp.inf, 0.0 * numerator), quotient)


def squared(x: Any) -> Any:
    """x²."""
    return x * x


def cubed(x: Any) -> Any:
    """x³."""
    return x * (x * x)


@partial(jax.jit, static_argnames="by")
def inverse_root(x: Any, by: Division) -> Any:
    """1/√x, and 0 where x is not positive."""
    zero = x <= 0
    return jnp.where(zero, 0.0, by.inverse_root(jnp.where(zero, 1.0, x)))
