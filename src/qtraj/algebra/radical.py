"""Sums of products of polynomials and any number of roots, as they occur in quantities of one's own.

`Surd` is the special case of two roots. The radicands are numbered, and a radicand may itself contain roots with
smaller numbers. The sign of a sum P + Q√R, where R has the largest number, follows from the signs of P, Q and
P² − Q²R, which contain only roots with smaller numbers (see `signs.with_root`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from qtraj.algebra.sparse import add, is_zero, mul, sub

Key = frozenset[int]
"""The numbers of the roots in a product."""

RATIONAL: Key = frozenset()
"""The key of terms without roots."""


class RadicalSum:
    """The sum of `terms`: coefficients of products of roots, by the numbers of the roots.

    `radicands` are the squares of the roots, shared by all sums of one proof. Radicands must not be negative.
    """

    __slots__ = ("radicands", "terms")

    def __init__(self, terms: Mapping[Key, Any], radicands: list[Any]):
        self.terms = {key: x for key, x in terms.items() if not is_zero(x)}
        self.radicands = radicands

    @classmethod
    def root(cls, square: Any, radicands: list[Any]) -> RadicalSum:
        """Return the root of `square`, which becomes a new radicand."""
        radicands.append(square)
        return cls({frozenset([len(radicands) - 1]): 1}, radicands)

    def __add__(self, other: Any) -> RadicalSum:
        other = self._sum_of(other)
        keys = {**self.terms, **other.terms}
        return RadicalSum({key: add([self.terms.get(key, 0), other.terms.get(key, 0)]) for key in keys}, self.radicands)

    __radd__ = __add__

    def __neg__(self) -> RadicalSum:
        return RadicalSum({key: sub(0, x) for key, x in self.terms.items()}, self.radicands)

    def __sub__(self, other: Any) -> RadicalSum:
        return self + -self._sum_of(other)

    def __rsub__(self, other: Any) -> RadicalSum:
        return -self + other

    def __mul__(self, other: Any) -> RadicalSum:
        if not isinstance(other, RadicalSum):
            return RadicalSum({key: mul(x, other) for key, x in self.terms.items()}, self.radicands)
        result = RadicalSum({}, self.radicands)
        for p, x in self.terms.items():
            for q, y in other.terms.items():
                term = RadicalSum({p ^ q: mul(x, y)}, self.radicands)
                for k in p & q:
                    term = term * self.radicands[k]
                result = result + term
        return result

    __rmul__ = __mul__

    def tree(self, leaf: Callable[[Any], int]) -> Any:
        """Return the tree of `signs.with_root` that determines the sign; `leaf` stores a polynomial."""
        numbers = frozenset().union(*self.terms)
        if not numbers:
            return leaf(self.terms.get(RATIONAL, 0))
        last = max(numbers)
        without = RadicalSum({key: x for key, x in self.terms.items() if last not in key}, self.radicands)
        factor = RadicalSum({key - {last}: x for key, x in self.terms.items() if last in key}, self.radicands)
        if not without.terms:
            return factor.tree(leaf)
        difference = without * without - factor * factor * self.radicands[last]
        return without.tree(leaf), factor.tree(leaf), difference.tree(leaf)

    def _sum_of(self, x: Any) -> RadicalSum:
        return x if isinstance(x, RadicalSum) else RadicalSum({RATIONAL: x}, self.radicands)
