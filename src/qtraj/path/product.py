"""Formulas of quantities of one's own: products of powers of sums, recorded while the user's function is called.

Every formula is c·Π f^(e/2), with a rational number c, integers e, and factors f. A factor is a scalar product of two
vectors, a component of a vector, a parameter of the vehicle, or a sum of such products without negative exponents. So
quotients and roots of products remain products, equal factors cancel, and the numerator and the denominator of a
formula are known. `formula` computes the values, over any arithmetic.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from fractions import Fraction
from numbers import Rational, Real
from typing import Any

import numpy as np

LARGEST = Fraction(sys.float_info.max)
"""The largest constant of a quantity: that of float64."""

Degree = Callable[["Factor"], Fraction | None]
"""The degree of a factor that is not a sum; None if it has none."""


class Factor:
    """A factor of a product: `kind` and `parts` identify it, and `positive` means that it is never negative.

    The kinds are "dot" (two vectors), "component" (a vector and an axis), "level" (a vector, for the square of its
    horizontal part), "parameter" (its name) and "sum" (its `terms`, in any order).
    """

    __slots__ = ("_hash", "kind", "parts", "positive", "terms")

    def __init__(self, kind: str, parts: tuple[Any, ...], positive: bool = False, terms: tuple[Product, ...] = ()):
        self.kind, self.parts, self.positive, self.terms = kind, parts, positive, terms
        self._hash = hash((kind, parts))

    @property
    def vectors(self) -> tuple[Any, ...]:
        """The vectors in a factor that is not a sum, as often as they are multiplied."""
        return {"dot": self.parts, "component": self.parts[:1], "level": 2 * self.parts}.get(self.kind, ())

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, Factor)
            and self._hash == other._hash
            and (self.kind, self.parts) == (other.kind, other.parts)
        )


class Product:
    """The number c·Π f^(e/2): a `coefficient` c and the exponents e of the factors f."""

    __slots__ = ("coefficient", "exponents")
    __array_ufunc__ = None  # a NumPy number on the left of an operator leaves the operation to this class

    def __init__(self, coefficient: Fraction, exponents: Mapping[Factor, int] | None = None):
        self.coefficient = coefficient
        self.exponents = {f: e for f, e in (exponents or {}).items() if e} if coefficient else {}

    @property
    def positive(self) -> bool:
        """Whether the product is known to be never negative."""
        return self.coefficient >= 0 and all(f.positive or e % 2 or e % 4 == 0 for f, e in self.exponents.items())

    def __mul__(self, other: Any) -> Product:
        other = product_of(other)
        if other is None:
            return NotImplemented
        exponents = dict(self.exponents)
        for f, e in other.exponents.items():
            exponents[f] = exponents.get(f, 0) + e
        return Product(self.coefficient * other.coefficient, exponents)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Product:
        other = product_of(other)
        if other is None:
            return NotImplemented
        if not other.coefficient:
            raise ZeroDivisionError("the function divides by zero")
        return self * Product(1 / other.coefficient, {f: -e for f, e in other.exponents.items()})

    def __rtruediv__(self, other: Any) -> Product:
        other = product_of(other)
        return NotImplemented if other is None else other / self

    def __add__(self, other: Any) -> Product:
        other = product_of(other)
        return NotImplemented if other is None else total([self, other])

    __radd__ = __add__

    def __neg__(self) -> Product:
        return Product(-self.coefficient, self.exponents)

    def __sub__(self, other: Any) -> Product:
        other = product_of(other)
        return NotImplemented if other is None else total([self, -other])

    def __rsub__(self, other: Any) -> Product:
        return -self + other

    def __pow__(self, power: Any) -> Product:
        power = power.item() if isinstance(power, np.generic) else power
        if not isinstance(power, int | float) or not float(twice := 2 * power).is_integer():
            return NotImplemented
        if int(twice) % 2:
            return self.sqrt() ** int(twice)
        whole = int(twice) // 2
        if whole < 0:
            return Product(Fraction(1)) / self**-whole
        return Product(self.coefficient**whole, {f: e * whole for f, e in self.exponents.items()})

    def __abs__(self) -> Product:
        return self if self.positive else (self * self).sqrt()

    def sqrt(self) -> Product:
        """Return the root of the product."""
        if self.coefficient < 0 and not self.exponents:
            raise ValueError("the function takes the root of a negative number")
        root, rest = _rational_root(self.coefficient)
        outside: dict[Factor, int] = {}
        inside: dict[Factor, int] = {}
        for f, e in self.exponents.items():
            simple = (f.positive and e % 2 == 0) or e % 8 == 0  # the root of f⁴ is f², but that of f² is |f|
            (outside if simple else inside)[f] = e
        if rest == 1 and len(inside) == 1 and abs(next(iter(inside.values()))) == 2:
            outside |= inside
        elif rest != 1 or inside:
            radicand = Product(rest, inside)
            outside |= _as_sum([radicand])
        return Product(root, {f: e // 2 for f, e in outside.items()})

    def __float__(self) -> float:
        raise TypeError("a formula of a quantity is not a number: use + - * / and qtraj.sqrt")

    def __bool__(self) -> bool:
        raise TypeError("a formula of a quantity has no truth value")

    def __eq__(self, other: object) -> bool:
        raise TypeError("a formula of a quantity cannot be compared")

    __hash__ = None  # type: ignore[assignment]

    def degree(self, of: Degree) -> Fraction | None:
        """Return the degree of the product in variables for which the degrees of factors that are not sums are known.

        The result is None if the product is not homogeneous.
        """
        found = Fraction(0)
        for f, e in self.exponents.items():
            own = _degree(f, of)
            if own is None:
                return None
            found += own * e / 2
        return found

    def factors(self) -> set[Factor]:
        """Return all factors, also those of sums, that are not sums."""
        found: set[Factor] = set()
        for f in self.exponents:
            found |= set().union(*(x.factors() for x in f.terms)) if f.kind == "sum" else {f}
        return found

    def radicands(self) -> list[Factor]:
        """Return the factors whose roots occur in the formula, and that are not known to be positive."""
        found: dict[Factor, None] = {}
        for f, e in self.exponents.items():
            if e % 2 and not f.positive:
                found[f] = None
            if f.kind == "sum":
                for term in f.terms:
                    found |= dict.fromkeys(term.radicands())
        return list(found)

    def key(self) -> tuple[Any, ...]:
        """Return a hashable value that identifies the formula."""
        return self.coefficient, frozenset(self.exponents.items())


def product_of(x: Any) -> Product | None:
    """Return a number as a product, and a product unchanged; None for anything else.

    **Raises:** ValueError for a number that is not finite.
    """
    if isinstance(x, Product):
        return x
    if isinstance(x, np.ndarray | np.generic) and np.ndim(x) == 0:
        x = x.item()
    if isinstance(x, bool) or not isinstance(x, Real):
        return None
    if not isinstance(x, Rational) and not math.isfinite(x):
        raise ValueError(f"a constant in a quantity must be finite, but {x} was given")
    exact = Fraction(x)  # type: ignore[arg-type]
    if abs(exact) > LARGEST:
        raise ValueError(f"a constant in a quantity must be at most {float(LARGEST):.6g}, but a larger one was given")
    return Product(exact)


def total(products: list[Product], positive: bool = False) -> Product:
    """Return the sum of products; `positive` means that it is known to be never negative."""
    same: dict[frozenset, Fraction] = {}
    for x in products:
        key = frozenset(x.exponents.items())
        same[key] = same.get(key, Fraction(0)) + x.coefficient
    products = [Product(c, dict(key)) for key, c in _with_levels({k: c for k, c in same.items() if c}).items()]
    if len(products) <= 1:
        return products[0] if products else Product(Fraction(0))
    shared = {
        f: min(x.exponents.get(f, 0) for x in products) for f in dict.fromkeys(f for x in products for f in x.exponents)
    }
    outside = Product(Fraction(1), shared)
    inside = [x / outside for x in products]
    scale = Fraction(1, math.lcm(*(_odd(x.coefficient.denominator) for x in inside)))
    return outside * Product(scale, _as_sum([x / Product(scale) for x in inside], positive and outside.positive))


def _with_levels(terms: dict[frozenset, Fraction]) -> dict[frozenset, Fraction]:
    """Return a sum in which the squares of components of a vector are collected.

    With the horizontal square h, x² + y² and |a|² − z² become h, and h + z² becomes |a|². So horizontal parts are
    known to be positive, and do not depend on the directions of x and y.
    """
    found = dict(terms)
    for key in terms:
        for f, e in key:
            for one, other, sign, result in _collected(f, e):
                partner = (key - {one}) | {other}
                c = found.get(key)
                if c is None or len(partner) != len(key) or found.get(partner) != sign * c:
                    continue
                del found[key], found[partner]
                whole = dict(key - {one})
                whole[result] = whole.get(result, 0) + 2
                merged = frozenset(whole.items())
                found[merged] = found.get(merged, Fraction(0)) + c
                return _with_levels({k: c for k, c in found.items() if c})
    return found


def _collected(f: Factor, e: int) -> list[tuple[tuple[Factor, int], tuple[Factor, int], int, Factor]]:
    """Return which power of a factor is collected with which other power of which sign, and the result."""
    if f.kind not in ("component", "dot", "level"):
        return []
    basic = f.parts[0]
    x, y, z = (Factor("component", (basic, k)) for k in range(3))
    whole, level = Factor("dot", (basic, basic), positive=True), Factor("level", (basic,), positive=True)
    pairs = [((x, 4), (y, 4), 1, level), ((whole, 2), (z, 4), -1, level), ((level, 2), (z, 4), 1, whole)]
    return [pair for pair in pairs if pair[0] == (f, e)]


def _as_sum(products: list[Product], positive: bool = False) -> dict[Factor, int]:
    """Return the exponents of a sum of products as one factor, and of the even powers by which a product is divided."""
    denominators: dict[Factor, int] = {}
    if len(products) == 1:
        denominators = {f: (-e + 7) // 8 * 8 for f, e in products[0].exponents.items() if e < 0}
        products = [products[0] * Product(Fraction(1), denominators)]
    positive = positive or all(x.positive for x in products)
    terms = frozenset(x.key() for x in products)
    return {Factor("sum", (terms,), positive, tuple(products)): 2} | {f: -e for f, e in denominators.items()}


def _degree(f: Factor, of: Degree) -> Fraction | None:
    if f.kind != "sum":
        return of(f)
    found = {x.degree(of) for x in f.terms}
    return found.pop() if len(found) == 1 else None


def _odd(n: int) -> int:
    return n // (n & -n)


def _rational_root(c: Fraction) -> tuple[Fraction, Fraction]:
    """Return r and an integer s with √c = r·√s; s is 1 for the square of a rational number."""
    p, q = c.numerator * c.denominator, c.denominator
    root = math.isqrt(abs(p))
    return (Fraction(root, q), Fraction(1)) if root * root == p else (Fraction(1, q), Fraction(p))
