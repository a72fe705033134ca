"""Vectors in formulas of quantities of one's own: sums of products with the derivatives of the path."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from qtraj.path.product import Factor, Product, product_of, total

Basic = tuple[Any, ...]
"""A vector without a factor: ("derivative", k), ("cross", a, b) with two basic vectors, or ("axis", k) of the world."""

ONE = Product(Fraction(1))


class ProductVector:
    """A vector in world axes: the sum of `terms`, pairs of a product and a basic vector.

    It has `dot`, `cross`, `norm`, the operators + − and, with numbers, × and ÷, and the components x, y and z.
    """

    __slots__ = ("terms",)
    __array_ufunc__ = None

    def __init__(self, terms: dict[Basic, Product]):
        self.terms = {basic: x for basic, x in terms.items() if x.coefficient}

    @classmethod
    def derivative(cls, order: int) -> ProductVector:
        """Return the derivative of the path of this order."""
        return cls({("derivative", order): ONE})

    def dot(self, other: Any) -> Product:
        """Return the scalar product with another vector, or with three numbers."""
        other = vector_of(other)
        pairs = [x * y * _dot(a, b) for a, x in self.terms.items() for b, y in other.terms.items()]
        return total(pairs, positive=self._key() == other._key())

    def cross(self, other: Any) -> ProductVector:
        """Return the cross product with another vector, or with three numbers."""
        result = ProductVector({})
        for a, x in self.terms.items():
            for b, y in vector_of(other).terms.items():
                result = result + _cross(a, b) * (x * y)
        return result

    def _key(self) -> dict[Basic, Any]:
        return {basic: x.key() for basic, x in self.terms.items()}

    def norm(self) -> Product:
        """Return the length of the vector."""
        return self.dot(self).sqrt()

    def __getitem__(self, axis: Any) -> Product:
        if not isinstance(axis, int) or not -3 <= axis < 3:
            raise IndexError(f"a vector has the components 0, 1 and 2 (world x, y and z), but {axis!r} was given")
        return total([x * _component(basic, axis % 3) for basic, x in self.terms.items()])

    def __iter__(self) -> Iterator[Product]:
        return iter((self[0], self[1], self[2]))

    def __len__(self) -> int:
        return 3

    def __add__(self, other: Any) -> ProductVector:
        terms = dict(self.terms)
        for basic, x in vector_of(other).terms.items():
            terms[basic] = total([terms[basic], x]) if basic in terms else x
        return ProductVector(terms)

    __radd__ = __add__

    def __neg__(self) -> ProductVector:
        return self * -1

    def __sub__(self, other: Any) -> ProductVector:
        return self + -vector_of(other)

    def __rsub__(self, other: Any) -> ProductVector:
        return -self + other

    def __mul__(self, factor: Any) -> ProductVector:
        known = product_of(factor)
        if known is None:
            raise TypeError(f"a vector is multiplied by numbers, but {factor!r} was given: use .dot or .cross")
        return ProductVector({basic: x * known for basic, x in self.terms.items()})

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> ProductVector:
        return self * (ONE / divisor)


def vector_of(x: Any) -> ProductVector:
    """Return three numbers as a vector, and a vector unchanged.

    **Raises:** TypeError for anything else.
    """
    if isinstance(x, ProductVector):
        return x
    parts = [product_of(part) for part in x] if hasattr(x, "__len__") and len(x) == 3 else [None]
    if any(part is None for part in parts):
        raise TypeError(f"a vector or three numbers were expected, but {x!r} was given")
    return ProductVector({("axis", k): part for k, part in enumerate(parts)})  # type: ignore[misc]


def _component(basic: Basic, axis: int) -> Product:
    if basic[0] == "axis":
        return Product(Fraction(int(basic[1] == axis)))
    return Product(Fraction(1), {Factor("component", (basic, axis)): 2})


def _dot(a: Basic, b: Basic) -> Product:
    if "axis" in (a[0], b[0]):
        return _component(b, a[1]) if a[0] == "axis" else _component(a, b[1])
    parts = (a, b) if repr(a) <= repr(b) else (b, a)
    return Product(Fraction(1), {Factor("dot", parts, positive=a == b): 2})


def _cross(a: Basic, b: Basic) -> ProductVector:
    if a == b:
        return ProductVector({})
    if a[0] == b[0] == "axis":
        sign = 1 if (b[1] - a[1]) % 3 == 1 else -1
        return ProductVector({("axis", 3 - a[1] - b[1]): ONE * sign})
    if b[0] == "axis":
        return -_cross(b, a)
    if a[0] == "axis":
        second, third = (a[1] + 1) % 3, (a[1] + 2) % 3
        return ProductVector({("axis", second): -_component(b, third), ("axis", third): _component(b, second)})
    if repr(a) > repr(b):
        return -_cross(b, a)
    return ProductVector({("cross", a, b): ONE})
