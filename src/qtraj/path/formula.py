"""Compute formulas of quantities of one's own (see `product`), over any arithmetic of `Invariants`.

With arrays or jets a formula is a number. In proofs it is a polynomial, or a sum with roots (`algebra.radical`).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

from qtraj.algebra.sparse import add, mul
from qtraj.foundation.namespace import xp
from qtraj.path.components import cross, dot
from qtraj.path.product import Factor, Product
from qtraj.path.product_vector import Basic

VELOCITY, ACCELERATION, JERK = (("derivative", k) for k in (1, 2, 3))
CROSS: Basic = ("cross", VELOCITY, ACCELERATION)

SHARED = {
    (VELOCITY, VELOCITY): "S",
    (ACCELERATION, ACCELERATION): "A",
    (JERK, JERK): "J",
    (VELOCITY, ACCELERATION): "B",
    (VELOCITY, JERK): "C",
    (CROSS, CROSS): "N",
    (CROSS, JERK): "T",
}
"""Scalar products that `Invariants` computes for the other quantities, too."""


def numerator(formula: Product, i: Any, power: int = 1) -> Any:
    """Return the numerator of a `power` of a formula, 1 or 2."""
    exponents = _exponents(formula, power)
    factors = [raised(f, abs(e) if e > 0 else 2, i) for f, e in exponents.items() if e > 0 or _changes_sign(f, e)]
    return _product(_parts(formula.coefficient**power)[0], factors, i)


def denominator(formula: Product, i: Any, power: int = 1) -> Any:
    """Return the denominator of a `power` of a formula, which is never negative; the integer 1 if it has none."""
    exponents = _exponents(formula, power)
    factors = [raised(f, -e + (2 if _changes_sign(f, e) else 0), i) for f, e in exponents.items() if e < 0]
    return _product(_parts(formula.coefficient**power)[1], factors, i)


def has_denominator(formula: Product) -> bool:
    """Return whether a formula is a quotient."""
    return _parts(formula.coefficient)[1] != 1 or any(e < 0 for e in formula.exponents.values())


def value(formula: Product, i: Any) -> Any:
    """Return the value of a formula in floating point; infinite at a pole, and 0 for 0/0."""
    a, b = numerator(formula, i), denominator(formula, i)
    if type(b) is int:
        return a
    zero = b <= 0
    pole = xp.where(a > 0, xp.inf, xp.where(a < 0, -xp.inf, 0.0))
    return xp.where(zero, pole, a / xp.where(zero, 1.0, b))


def raised(f: Factor, exponent: int, i: Any) -> Any:
    """Return f^(exponent/2), for an exponent that is not negative."""
    whole, has_root = divmod(exponent, 2)
    found: Any = 1
    if whole:
        x = evaluated(f, i)
        for _ in range(whole):
            found = mul(x, found)
    return mul(_root(f, i), found) if has_root else found


def evaluated(f: Factor, i: Any) -> Any:
    """Return the value of a factor, which is computed once for all formulas."""
    known = i.__dict__.setdefault("factors", {})
    if f not in known:
        known[f] = _evaluated(f, i)
    return known[f]


def _evaluated(f: Factor, i: Any) -> Any:
    if f.kind == "sum":
        return add([_product(x.coefficient, [raised(g, e, i) for g, e in x.exponents.items()], i) for x in f.terms])
    if f.kind == "parameter":
        return getattr(i.vehicle, f.parts[0])
    if f.kind == "dot":
        name = SHARED.get(f.parts)
        return getattr(i, name) if name else dot(_vector(f.parts[0], i), _vector(f.parts[1], i))
    if f.kind == "level":
        return i.H if f.parts[0] == VELOCITY else i.level_square(_vector(f.parts[0], i))
    basic, axis = f.parts
    return i.vertical(_vector(basic, i)) if axis == 2 else _vector(basic, i)[axis]


def _vector(basic: Basic, i: Any) -> Any:
    if basic[0] == "derivative":
        return i.r[basic[1]]
    if basic == CROSS:
        return i.c
    known = i.__dict__.setdefault("vectors", {})
    if basic not in known:
        known[basic] = cross(_vector(basic[1], i), _vector(basic[2], i))
    return known[basic]


def _root(f: Factor, i: Any) -> Any:
    known = i.__dict__.setdefault("roots", {})
    if f not in known:
        x = evaluated(f, i)
        known[f] = math.sqrt(max(x, 0.0)) if isinstance(x, float) else i.root(x)
    return known[f]


def _parts(c: Fraction) -> tuple[Fraction, Fraction]:
    """Return dyadic numbers p and q of moderate size with c = p/q; q is 1 if c is dyadic."""
    q = c.denominator
    if q & (q - 1) == 0:
        return c, Fraction(1)
    scale = Fraction(1, 1 << q.bit_length())
    return c.numerator * scale, q * scale


def _exponents(formula: Product, power: int) -> dict[Factor, int]:
    return {f: power * e for f, e in formula.exponents.items()}


def _changes_sign(f: Factor, e: int) -> bool:
    """Return whether a divisor is an odd power of a factor that may be negative."""
    return e < 0 and not f.positive and e % 4 == 2


def _product(coefficient: Fraction, factors: list[Any], i: Any) -> Any:
    found: Any = 1
    for x in factors:
        found = mul(found, x)
    return found if coefficient == 1 else mul(found, i.number(coefficient))
