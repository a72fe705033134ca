"""Enclose the roots √S, √H and √a in cells between polynomials, so that claims with roots need no squares of squares.

A sum a + b√S + c√H + d√(SH) is affine in each of its roots. So it lies between its values for the lower and the upper
bounds on the roots. In a small cell the bounds are so close that this decides nearly every claim, with polynomials of
low degree.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.signs import Signs
from qtraj.algebra.sparse import add, is_zero, mul
from qtraj.algebra.surd import Surd

DEGREE = 5
NODES = (1 - np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))) / 2
SAMPLES = np.linspace(0.0, 1.0, 17)

NARROWEST = 1e-9
"""Lower bound on the relative width of an enclosure; the conditions on narrower ones could not be proved in floats."""

WIDEST = 1e-6
"""Largest relative width of an enclosure; the claims in all other cells are decided by squares."""


class Enclosure(NamedTuple):
    """The polynomials `middle` ± `width` in n cells enclose a root; `width` is NaN where it would be large."""

    middle: Float[Any, "terms n"]
    width: Float[Any, " n"]

    def bounded(self, square: BoundedPolynomial) -> Root:
        """Return the root in bounded floats; `square` is its square."""
        middle, width = BoundedPolynomial(self.middle), BoundedPolynomial.constant(self.width)
        return Root(square, middle - width, middle + width)

    def exact(self, square: ExactPolynomial, k: int) -> Root:
        """Return the root in exact integers in cell k."""
        middle, width = ExactPolynomial.from_floats(self.middle[:, k]), ExactPolynomial.of(self.width[k])
        return Root(square, middle - width, middle + width)

    @property
    def good(self) -> Bool[Any, " n"]:
        """Whether a cell has an enclosure."""
        return np.isfinite(self.width)


class Root(NamedTuple):
    """A root, and polynomials that enclose it."""

    square: Any
    low: Any
    high: Any

    def conditions(self) -> list[Any]:
        """Return polynomials that are nonnegative where the root lies between its bounds."""
        return [self.low, self.square - self.low * self.low, self.high * self.high - self.square]


def enclosure(square: Float[Any, "terms n"]) -> Enclosure:
    """Interpolate the root of polynomials; the conditions of `Root` are proved with the claims."""
    with np.errstate(all="ignore"):
        middle = np.linalg.solve(np.vander(NODES, increasing=True), np.sqrt(_values(square, NODES)))
        root = np.sqrt(_values(square, SAMPLES))
        largest = root.max(axis=0)
        width = 2 * np.abs(_values(middle, SAMPLES) - root).max(axis=0) + NARROWEST * largest
        return Enclosure(middle, np.where(width <= WIDEST * root.min(axis=0), width, np.nan))


def _values(c: Float[Any, "terms n"], u: Float[Any, " m"]) -> Float[Any, "m n"]:
    return np.vander(u, len(c), increasing=True) @ c


def at_bounds(number: Any, roots: Sequence[Root]) -> list[Any]:
    """Return a sum with roots (S, H) for all combinations of the bounds on the roots that it contains."""
    if not isinstance(number, Surd):
        return [number]
    a, b, c, d = number.terms
    pairs = zip(roots, ((b, d), (c, d)), strict=True)
    sides = [[0] if all(map(is_zero, own)) else [root.low, root.high] for root, own in pairs]
    return [add([a, mul(b, s), mul(c, h), mul(d, mul(s, h))]) for s, h in itertools.product(*sides)]


class Enclosed:
    """The claim that a function is nonnegative, of which the polynomials `values` are bounds if `conditions` hold.

    At each point, the function lies between the smallest and the largest one of the values.
    """

    def __init__(self, values: Sequence[Any], roots: Sequence[Root]):
        conditions = [p for root in roots for p in root.conditions()]
        self.polynomials = [*values, *conditions]
        self._count = len(values)

    def sign(self, signs: Sequence[Signs]) -> Signs:
        """Return the signs of the function from the signs of its polynomials."""
        valid = _all([x.ge for x in signs[self._count :]])
        return Signs(*(valid & _all(list(own)) for own in zip(*signs[: self._count], strict=True)))


def _all(values: list[Any]) -> Any:
    result = values[0]
    for x in values[1:]:
        result = result & x
    return result
