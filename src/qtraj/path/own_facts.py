"""What a proof must know about a quantity of one's own: its order, its divisors, and how it behaves at a stop."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from qtraj.path.formula import ACCELERATION, CROSS, JERK, VELOCITY
from qtraj.path.product import Factor, Product
from qtraj.path.product_vector import Basic

NONZERO = ("mass", "wheelbase", "inv_long", "inv_lat")
"""The parameters of a vehicle that are positive for every vehicle."""

POSITION: Basic = ("derivative", 0)


@dataclass(frozen=True)
class Guard:
    """A factor that must be nonzero or, if it is not a `divisor`, must not be negative because of its root.

    `exponents` are those of m and s in its unit, or None if it has none.
    """

    factor: Factor
    divisor: bool
    exponents: tuple[Any, ...] | None


@dataclass(frozen=True)
class OwnFacts:
    """Properties of a quantity of one's own, in addition to those of `PathQuantity`.

    `formula` is None for a function that is not a formula, which is only sampled. `in_si` means that the function
    contains numbers with a unit, so that it is computed in SI units. `world` means that it contains world components x
    or y, or more of the position than its height, which are polynomials only on paths in world axes. `shape` means that
    it does not depend on the timing. `stop` is how it is proved next to a stop, "path", "direction", "component" or
    "shape" (see `design.proof.route_segments`). The quantity exists where all `guards` are satisfied. `zero_at_rest`
    means that it tends to zero if all derivatives of the path are multiplied by a factor that does.
    """

    formula: Product | None = field(compare=False)
    in_si: bool = True
    world: bool = True
    shape: bool = False
    stop: str = "path"
    guards: tuple[Guard, ...] = ()
    zero_at_rest: bool = False


def vectors_of(formula: Product) -> set[Basic]:
    """Return the derivatives and cross products in a formula."""
    return vectors_in(formula.factors())


def vectors_in(factors: Iterable[Factor]) -> set[Basic]:
    """Return the derivatives and cross products in factors."""
    found: set[Basic] = set()
    rest = [v for f in factors for v in f.vectors]
    while rest:
        basic = rest.pop()
        found.add(basic)
        rest += basic[1:] if basic[0] == "cross" else ()
    return found


def order_of(formula: Product) -> int:
    """Return the order of the highest derivative in a formula."""
    return max([0, *(v[1] for v in vectors_of(formula) if v[0] == "derivative")])


def axes_of(formula: Product) -> set[int]:
    """Return the world axes on which a formula depends."""
    return {2 if f.kind == "level" else f.parts[1] for f in formula.factors() if f.kind in ("component", "level")}


def only_height(formula: Product) -> bool:
    """Return whether a formula contains nothing of the position but its vertical component."""
    height = Factor("component", (POSITION, 2))
    return not any(POSITION in vectors_in([f]) for f in formula.factors() if f != height)


def is_shape(formula: Product) -> bool:
    """Return whether a formula has the same values for all timings of a path."""
    return formula.degree(lambda f: _weight(f, velocity=1, cross=3, triple=6, position=0)) == 0


def rate_degree(entry: Any) -> Fraction | None:
    """Return the degree in 1/s of an entry whose values on a shape depend only on the speed, as a power of it.

    The result is None for other entries. The formula then contains only the velocity and v × r̈, and no gravity.
    """
    degree = time_degree(entry)
    if degree is None or any(v not in (VELOCITY, CROSS) for f in entry.own.formula.factors() for v in f.vectors):
        return None
    return degree if degree > 0 else None


def time_degree(entry: Any) -> Fraction | None:
    """Return the exponent k of an own quantity that is multiplied by f^k on a path that is traversed f times as fast.

    The result is None for other entries, such as formulas with gravity.
    """
    formula = None if entry.own is None else entry.own.formula
    if formula is None or any(f.kind == "parameter" and f.parts[0] == "gravity" for f in formula.factors()):
        return None
    return formula.degree(lambda f: Fraction(sum(v[1] for v in _derivatives_in(f))))


def is_linear(entry: Any) -> bool:
    """Return whether an own quantity is linear in the acceleration, with a factor that depends only on the direction.

    Examples are v·a/|v| and a component of the acceleration.
    """
    return time_degree(entry) == 2 and _is_linear(entry.own.formula)


def _is_linear(formula: Product) -> bool:
    """Return whether a formula is linear in the acceleration; its other factors are of the velocity or constant."""
    changing = [(f, e) for f, e in formula.exponents.items() if any(v != VELOCITY for v in vectors_in(_leaves(f)))]
    if len(changing) != 1 or changing[0][1] != 2:
        return False
    f = changing[0][0]
    if f.kind == "sum":
        return all(_is_linear(term) for term in f.terms)
    higher = [v for v in f.vectors if v != VELOCITY]
    return f.kind != "level" and len(higher) == 1 and higher[0] in (ACCELERATION, CROSS)


def _leaves(f: Factor) -> set[Factor]:
    return set().union(*(x.factors() for x in f.terms)) if f.kind == "sum" else {f}


def is_zero_at_rest(formula: Product) -> bool:
    """Return whether a formula has a positive degree in the derivatives of the path."""
    return (formula.degree(_derivatives) or 0) > 0


def is_infinite_at_rest(facts: OwnFacts | None) -> bool:
    """Return whether a quantity, such as v·a/v², tends to infinity where a vehicle starts, comes to rest or stands.

    There v × r̈ tends to zero as v³, because the motion follows a curve. Quantities of the shape do not count.
    """
    if facts is None or facts.formula is None or facts.shape:
        return False
    degree = facts.formula.degree(lambda f: Fraction(sum({VELOCITY: 1, CROSS: 3}.get(v, 0) for v in f.vectors)))
    return degree is not None and degree < 0


def stop_of(formula: Product, shape: bool) -> str:
    """Return how a quantity with a divisor is proved next to a stop; see `OwnFacts`."""
    if formula.degree(lambda f: _weight(f, velocity=1, cross=2, triple=3)) == 0:
        return "direction"
    if POSITION in vectors_of(formula):  # only the sources of whole segments contain the position
        return "path"
    if formula.degree(velocities) == 0:
        return "component"
    return "shape" if shape else "path"


def divisor_of(formula: Product) -> tuple[str | None, list[Factor]]:
    """Return the name of the registry's divisor that makes a formula exist, and all other divisors."""
    speed = Factor("dot", (VELOCITY, VELOCITY))
    bend = Factor("dot", (CROSS, CROSS))
    level = Factor("level", (VELOCITY,))
    divisors = [f for f, e in formula.exponents.items() if e < 0 and f.parts[0] not in NONZERO]
    name = "speed" if speed in divisors else None
    if level in divisors or bend in divisors:
        name = "level" if level in divisors else "cross_norm"
    named = (speed, level if name == "level" else bend)
    return name, [f for f in divisors if f not in named]


def _weight(f: Factor, velocity: int, cross: int, triple: int, position: int | None = None) -> Fraction | None:
    """Return the power of a factor by which a factor of the velocity multiplies it; None if there is no such power."""
    if f.kind == "dot" and f.parts == (CROSS, JERK):
        return Fraction(triple)
    known = {VELOCITY: velocity, CROSS: cross} | ({} if position is None else {POSITION: position})
    return Fraction(sum(known[v] for v in f.vectors)) if all(v in known for v in f.vectors) else None


def velocities(f: Factor) -> Fraction:
    """Return the degree of a factor in the velocity."""
    return Fraction(sum(basic == VELOCITY for basic in _derivatives_in(f)))


def _derivatives(f: Factor) -> Fraction:
    """Return the degree of a factor in the derivatives of the path, without the position."""
    return Fraction(sum(basic != POSITION for basic in _derivatives_in(f)))


def _derivatives_in(f: Factor) -> list[Basic]:
    """Return the derivatives in a factor that is not a sum, as often as they are multiplied."""
    found, rest = [], list(f.vectors)
    while rest:
        basic = rest.pop()
        if basic[0] == "cross":
            rest += basic[1:]
        else:
            found.append(basic)
    return found
