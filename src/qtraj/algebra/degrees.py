"""An arithmetic of degrees: the formulas of polynomials, evaluated with it, return bounds on the degrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class Degrees:
    """The largest `exponents` of some parameters in a polynomial in the time and these parameters."""

    __slots__ = ("exponents",)

    def __init__(self, exponents: Sequence[int]):
        self.exponents = tuple(exponents)

    def __add__(self, other: Any) -> Degrees:
        if isinstance(other, int | float):
            return self
        if not isinstance(other, Degrees):
            return NotImplemented
        return Degrees([max(x, y) for x, y in zip(self.exponents, other.exponents, strict=True)])

    __radd__ = __sub__ = __rsub__ = __add__

    def __neg__(self) -> Degrees:
        return self

    def __mul__(self, other: Any) -> Degrees:
        if isinstance(other, int | float):
            return self
        if not isinstance(other, Degrees):
            return NotImplemented
        return Degrees([x + y for x, y in zip(self.exponents, other.exponents, strict=True)])

    __rmul__ = __mul__

    def derivative(self) -> Degrees:
        """Return the degrees of the derivative with respect to the time."""
        return self
