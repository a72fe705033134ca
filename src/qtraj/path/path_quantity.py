"""Define an entry of the registry of path quantities: names, unit, and a formula that is a ratio of polynomials."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from qtraj.algebra.cpu import inverse_root
from qtraj.foundation import units
from qtraj.foundation.namespace import is_host, xp
from qtraj.path import angle

Formula = Callable[[Any], Any]
"""A function of `Invariants` of any numeric type."""


LOAD, FORCE, UPRIGHT_FORCE, ROAD_FRAME = "load", "force", "upright force", "road frame"
"""Names of divisors: the load on the road, the specific force, its norm across the path plus its part upwards, and the
component of the velocity normal to the axis of the road (see `RoadParameters`).

The third one vanishes where the part of the specific force across the path is zero or points straight down.
"""

VEHICLE, INERTIA, PRINCIPAL, WHEELBASE = "vehicle", "inertia", "principal inertia", "wheelbase"
PARAMETERS = "parameters"
"""What a quantity needs in addition to the path: a vehicle on a road, its inertia, principal axes of inertia along τ,
n, b, a wheelbase, or only parameters such as its mass."""


class Component(NamedTuple):
    """The signed value of a quantity whose entry describes its magnitude.

    It is numerator/denominator, where the denominator is positive and None is 1; `value` computes it in floating point.
    `divisor` is that of the signed value, if the magnitude has another one.
    """

    meaning: str
    numerator: Formula
    denominator: Formula | None
    value: Formula
    divisor: str | None = None


@dataclass(frozen=True)
class PathQuantity:
    """A quantity along a path, defined by the ratio numerator/denominator; a denominator of None is 1.

    If `signed` is None, the quantity is nonnegative and the ratio is its square. Otherwise the quantity can be negative
    and the ratio is the quantity itself; `signed` computes the quantity in floating point.

    `order` is the order of the highest derivative in the formulas, and `upright` indicates whether they contain the
    vertical. The quantity exists where `divisor` is not zero: "speed" (|r'|), "cross_norm" (|r' × r''|), "level" (the
    horizontal speed), "load" (the normal force on the road), "force" (the specific force), "upright force" or "road
    frame" (see the module). If `divisor` is None, the quantity exists everywhere. `square` is an equivalent form of the
    ratio for floating-point numbers, used if numerator and denominator would overflow or lose digits. `output` is the
    name in tables and datasets, if a vector already has the name of the quantity. `bounds_speed` indicates whether a
    limit on the quantity also bounds the speed on every path. `infinite` indicates where the quantity is infinite
    although the ratio is not. `of` names the frame whose motion the quantity describes, if another frame along the path
    has the same quantity.

    `needs` is empty for a quantity of the path alone. It is VEHICLE if the formulas use the forces of `contact`, and
    WHEELBASE if they use the wheelbase in `Invariants.vehicle`. It is PRINCIPAL if the quantity is `factor` times the
    square root of the ratio; `factor` is a function of the vehicle's parameters, in `factor_unit`. Then `squared`,
    `value` and `exceeds` refer to the quantity divided by its factor. `gravity` indicates formulas that contain
    gravity, as all forces between vehicle and road do; it is standard gravity without a vehicle.

    If `tangent_of` is a number k other than 0, the quantity is an angle, and the ratio is tan(angle/k), or its square.
    Proofs and searches use the ratio and the tangents of limits; `squared` and `value` are those of the angle.

    `component` describes the signed value, if the quantity is its magnitude. A side of a limit (see `sides`) has the
    name of the limited quantity in `base`; if `lower` is set, the limit is a lower bound. `position` indicates formulas
    that contain the position, whose derivative of order 0 is `Invariants.r[0]`. `own` contains the `own_facts.OwnFacts`
    of a quantity that is defined by a user's function.
    """

    name: str
    symbol: str
    unit: str
    order: int
    meaning: str
    numerator: Formula
    denominator: Formula | None = None
    divisor: str | None = None
    square: Formula | None = None
    output: str = ""
    upright: bool = False
    bounds_speed: bool = False
    signed: Formula | None = None
    infinite: Formula | None = None
    of: str = ""
    needs: str = ""
    factor: Formula | None = None
    factor_unit: str = "1"
    component: Component | None = None
    base: str = ""
    lower: bool = False
    gravity: bool = False
    tangent_of: int = 0
    position: bool = False
    own: Any = None

    @property
    def side(self) -> int:
        """1 if a limit is an upper bound, −1 if it is a lower bound."""
        return -1 if self.lower else 1

    @property
    def bounds_side(self) -> bool:
        """Whether the entry is a side of a limit on a signed value."""
        return bool(self.base) and self.signed is not None

    @property
    def extreme(self) -> str:
        """The value that a limit bounds, in words: "largest" or "smallest"."""
        return "smallest" if self.lower else "largest"

    @property
    def variable(self) -> str:
        """The name of the quantity as an output of `qtraj.evaluate`."""
        return self.output or self.name

    @property
    def title(self) -> str:
        """The name of the output in words, with the frame that the quantity belongs to."""
        return self.variable.replace("_", " ") + (f" of the {self.of}" if self.of else "")

    @property
    def label(self) -> str:
        """The unit in display form; "-" for a dimensionless quantity."""
        return units.symbol(self.unit) or "-"

    @property
    def length(self) -> int:
        """The exponent of the metre in `unit`/`factor_unit`."""
        return units.base_powers(self.unit).get("m", 0) - units.base_powers(self.factor_unit).get("m", 0)

    @property
    def per_time(self) -> int:
        """The exponent of 1/s in `unit`/`factor_unit`."""
        return units.per_time(self.unit) - units.per_time(self.factor_unit)

    @property
    def uses_vehicle(self) -> bool:
        """Whether the value depends on a vehicle if there is one; a quantity that `needs` one is undefined without."""
        return bool(self.needs) or self.gravity

    def in_world(self, vehicle: Any) -> bool:
        """Return whether the formulas need world axes; `vehicle` contains the `RoadParameters`, or is None."""
        return self.of_world or self.about_axis(vehicle)

    def uses_axes(self, vehicle: Any) -> bool:
        """Return whether the formulas need world axes other than the vertical, and are no polynomials on a helix."""
        return self.about_axis(vehicle) or (self.own is not None and self.own.world)

    def about_axis(self, vehicle: Any) -> bool:
        """Return whether the formulas contain the axis of the road of a vehicle (see `in_world`)."""
        return self.needs == VEHICLE and self.own is None and vehicle is not None and vehicle.axis is not None

    @property
    def of_world(self) -> bool:
        """Whether the formulas contain the position, or components in world axes."""
        return self.position or (self.own is not None and self.own.world)

    @property
    def of_position(self) -> bool:
        """Whether the quantity depends on the position alone, as the height does."""
        return self.position and self.order == 0

    @property
    def of_shape(self) -> bool:
        """Whether the quantity depends only on the shape of a path, and perhaps a wheelbase, but not on the timing."""
        if self.own is not None:
            return self.own.shape
        timeless = self.per_time == 0 and not self.bounds_speed  # the combined acceleration is a ratio of two limits
        return timeless and not self.gravity and self.needs in ("", WHEELBASE)

    def tangent(self, limit: Any) -> Any:
        """Return the limit on the ratio, or its root, for a limit on the quantity; a tangent for an angle."""
        return angle.tangent(limit, self.tangent_of) if self.tangent_of else limit

    def strict_tangent(self, limit: Any) -> Any:
        """Return `tangent` in NumPy, rounded so that the limit on the ratio implies the limit on the quantity."""
        return angle.strict_tangent(limit, self.tangent_of, self.side) if self.tangent_of else limit

    def strict_curve(self, curve: Any) -> Any:
        """Return polynomials for limits on the ratio that imply the limits `curve`, both as Bernstein coefficients."""
        return angle.strict_curve(curve, self.tangent_of, self.side) if self.tangent_of else curve

    def of_tangent(self, ratio: Any) -> Any:
        """Return the value of the quantity for a value of `tangent`."""
        return angle.angle_of(ratio, self.tangent_of) if self.tangent_of else ratio

    def scale(self, vehicle: Any) -> Any:
        """Return the value of `factor` for the parameters of this vehicle, or 1 if there is no factor."""
        return 1.0 if self.factor is None else self.factor(vehicle)

    def squared(self, i: Any) -> Any:
        """Return the square of `value`, at one instant or many: `inf` at a pole, 0 if the quantity is negative."""
        if self.signed is not None:
            return squared(xp.maximum(self.signed(i), 0.0))
        if self.square is not None:
            return self.square(i)
        numerator = self.numerator(i)
        return numerator if self.denominator is None else ratio(numerator, self.denominator(i))

    def value(self, i: Any) -> Any:
        """Return the quantity, divided by its `factor`, in floating point at one instant or many; `inf` at a pole."""
        return i.root(self.squared(i)) if self.signed is None else self.signed(i)

    def exceeds(self, i: Any, bound: Any) -> Any:
        """Return whether the quantity, divided by its `factor`, violates `bound`; computed without division."""
        bound = self.tangent(bound)
        scaled = bound if self.signed else bound**2
        numerator, limit = self.numerator(i), scaled if self.denominator is None else scaled * self.denominator(i)
        if self.infinite is None:
            return numerator < limit if self.lower else numerator > limit
        infinite = self.infinite(i)
        return (numerator < limit) & ~infinite if self.lower else (numerator > limit) | infinite


def ratio(numerator: Any, denominator: Any) -> Any:
    """Return numerator/denominator; 0/0 is 0, and x/0 is `inf` with zero gradient; NaN remains NaN."""
    zero = denominator <= 0
    divisor = xp.where(zero, 1.0, denominator)
    # XLA's compiler for CPUs splits the loop over the instants at each division, but not at the products of a root.
    quotient = numerator / divisor if is_host(numerator, divisor) else numerator * inverse_root(divisor) ** 2
    return xp.where(zero, xp.where(numerator > 0, xp.inf, 0.0 * numerator), quotient)


def quotient(numerator: Any, square: Any) -> Any:
    """Return numerator/√square; 0/0 is 0, and x/0 is infinite with the sign of x and zero gradient."""
    infinite = xp.where(numerator > 0, xp.inf, xp.where(numerator < 0, -xp.inf, 0.0 * numerator))
    return xp.where(square > 0, numerator * inverse_root(square), infinite)


def squared(x: Any) -> Any:
    """Return the square of x."""
    return x * x


def cubed(x: Any) -> Any:
    """Return the cube of x."""
    return x * (x * x)
