"""Sums a + b√S + c√H + d√(SH), whose coefficients and radicands are polynomials of any arithmetic.

Limits on forces and power contain the speed √S and the horizontal speed √H. The sign of such a sum follows from the
signs of polynomials alone (`signs.with_root`), so it is decided without computing a root.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qtraj.algebra.radical import RadicalSum
from qtraj.algebra.signs import Signs, with_root
from qtraj.algebra.sparse import add, is_zero, mul, sub

Pair = tuple[Any, Any]
"""The coefficients (a, b) of a + b√S; a coefficient that is identically zero is the integer 0."""


class Surd:
    """The sum a + b√S + c√H + d√(SH) with `terms` (a, b, c, d) and `squares` (S, H).

    A term that is identically zero is the integer 0.
    """

    __slots__ = ("squares", "terms")

    def __init__(self, terms: Sequence[Any], squares: Pair):
        self.terms, self.squares = tuple(terms), squares

    def __add__(self, other: Any) -> Surd:
        if not isinstance(other, Surd):
            other = Surd((other, 0, 0, 0), self.squares)
        return Surd([add([x, y]) for x, y in zip(self.terms, other.terms, strict=True)], self._squares(other))

    __radd__ = __add__

    def __neg__(self) -> Surd:
        return Surd([sub(0, x) if not is_zero(x) else 0 for x in self.terms], self.squares)

    def __sub__(self, other: Any) -> Surd:
        return self + -other

    def __rsub__(self, other: Any) -> Surd:
        return -self + other

    def __mul__(self, other: Any) -> Surd:
        if not isinstance(other, Surd):
            return Surd([mul(x, other) for x in self.terms], self.squares)
        S, H = squares = self._squares(other)
        (a, b, c, d), (e, f, g, h) = self.terms, other.terms
        # (P + Q√H)(R + T√H) = PR + QTH + (PT + QR)√H, where P, Q, R and T have the form a + b√S.
        first = _sum(_times((a, b), (e, f), S), _scaled(_times((c, d), (g, h), S), H))
        second = _sum(_times((a, b), (g, h), S), _times((c, d), (e, f), S))
        return Surd((*first, *second), squares)

    __rmul__ = __mul__

    def _squares(self, other: Surd) -> Pair:
        """Return the squares of both sums: sums without the second root may be combined with any second root."""
        return other.squares if is_zero(self.terms[2]) and is_zero(self.terms[3]) else self.squares


class Claim:
    """A sum of polynomials and roots as a list of polynomials, whose signs determine the sign of the sum.

    `polynomials` are the leaves of a binary tree of `signs.with_root`; `sign` evaluates the tree.
    """

    __slots__ = ("_tree", "polynomials")

    def __init__(self, number: Any):
        self.polynomials: list[Any] = []
        if isinstance(number, Surd):
            a, b, c, d = number.terms
            self._tree = self._outer((a, b), (c, d), *number.squares)
        elif isinstance(number, RadicalSum):
            self._tree = number.tree(self._leaf)
        else:
            self._tree = self._leaf(number)

    def sign(self, signs: Sequence[Signs]) -> Signs:
        """Return the signs of the sum from the signs of its polynomials."""
        return _evaluated(self._tree, signs)

    def _leaf(self, polynomial: Any) -> int:
        self.polynomials.append(polynomial)
        return len(self.polynomials) - 1

    def _inner(self, pair: Pair, S: Any) -> Any:
        """Return the tree of a + b√S."""
        a, b = pair
        if is_zero(b) or is_zero(a):
            return self._leaf(a if is_zero(b) else b)
        return self._leaf(a), self._leaf(b), self._leaf(a * a - b * b * S)

    def _outer(self, first: Pair, second: Pair, S: Any, H: Any) -> Any:
        """Return the tree of P + Q√H, where P and Q have the form a + b√S."""
        if all(map(is_zero, second)):
            return self._inner(first, S)
        if all(map(is_zero, first)):
            return self._inner(second, S)
        squares = _times(first, first, S), _scaled(_times(second, second, S), H)
        difference = sub(squares[0][0], squares[1][0]), sub(squares[0][1], squares[1][1])
        return self._inner(first, S), self._inner(second, S), self._inner(difference, S)


def _evaluated(tree: Any, signs: Sequence[Signs]) -> Signs:
    return signs[tree] if isinstance(tree, int) else with_root(*(_evaluated(branch, signs) for branch in tree))


def _times(p: Pair, q: Pair, S: Any) -> Pair:
    """Return (a + b√S)(c + d√S)."""
    (a, b), (c, d) = p, q
    return add([mul(a, c), mul(mul(b, d), S)]), add([mul(a, d), mul(b, c)])


def _sum(p: Pair, q: Pair) -> Pair:
    return add([p[0], q[0]]), add([p[1], q[1]])


def _scaled(p: Pair, factor: Any) -> Pair:
    return mul(p[0], factor), mul(p[1], factor)
