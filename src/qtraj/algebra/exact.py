"""Polynomials with exact dyadic coefficients: Python integers times a common power of two.

Every float is an integer times a power of two, so sums and products of polynomials with float coefficients are exact
here. No rounding analysis is needed, and the results are the same on every machine.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

MANY = 20
"""From this number of coefficients on, polynomials are multiplied as long integers."""


class ExactPolynomial:
    """The polynomial Σ numbers[k]·u^k·2^exponent with integer `numbers`."""

    __slots__ = ("exponent", "numbers")

    def __init__(self, numbers: list[int], exponent: int = 0):
        self.numbers, self.exponent = numbers, exponent

    @classmethod
    def of(cls, x: Any) -> ExactPolynomial:
        """Return the constant polynomial with the value of a finite float, an integer, or a dyadic fraction."""
        if isinstance(x, Fraction):
            return cls([x.numerator], 1 - x.denominator.bit_length())
        return cls.from_floats([x])

    @classmethod
    def from_floats(cls, coefficients: Iterable[Any]) -> ExactPolynomial:
        """Return the polynomial with these ascending coefficients, which are finite floats or integers.

        **Raises:** OverflowError for an infinite coefficient, and ValueError for NaN.
        """
        ratios = [float(c).as_integer_ratio() for c in coefficients]
        bits = max(denominator for _, denominator in ratios).bit_length() - 1  # all denominators are powers of two
        shifts = [bits - denominator.bit_length() + 1 for _, denominator in ratios]
        return cls([number << shift for (number, _), shift in zip(ratios, shifts, strict=True)], -bits)._reduced()

    @property
    def is_zero(self) -> bool:
        """Whether the polynomial is identically zero."""
        return not any(self.numbers)

    def __add__(self, other: Any) -> ExactPolynomial:
        if not isinstance(other, ExactPolynomial):
            if not isinstance(other, int | float):
                return NotImplemented
            other = ExactPolynomial.of(other)
        a, b = (self, other) if len(self.numbers) >= len(other.numbers) else (other, self)
        exponent = min(a.exponent, b.exponent)
        p, q = a.exponent - exponent, b.exponent - exponent
        numbers = [x << p for x in a.numbers] if p else list(a.numbers)
        for k, x in enumerate(b.numbers):
            numbers[k] += x << q
        return ExactPolynomial(numbers, exponent)

    __radd__ = __add__

    def __neg__(self) -> ExactPolynomial:
        return ExactPolynomial([-x for x in self.numbers], self.exponent)

    def __sub__(self, other: Any) -> ExactPolynomial:
        return self + -other

    def __rsub__(self, other: Any) -> ExactPolynomial:
        return -self + other

    def __mul__(self, other: Any) -> ExactPolynomial:
        if not isinstance(other, ExactPolynomial):
            if not isinstance(other, int | float):
                return NotImplemented
            other = ExactPolynomial.of(other)
        exponent = self.exponent + other.exponent
        return ExactPolynomial(_product(self.numbers, other.numbers), exponent)

    __rmul__ = __mul__

    def derivative(self) -> ExactPolynomial:
        """Return the derivative with respect to u."""
        return ExactPolynomial([k * x for k, x in enumerate(self.numbers)][1:] or [0], self.exponent)

    def substituted(self, scale: float) -> ExactPolynomial:
        """Return the polynomial p(scale·u)."""
        factor = ExactPolynomial.of(scale)
        number, exponent = factor.numbers[0], factor.exponent
        top = len(self.numbers) - 1
        # The coefficient k is multiplied by (number·2^exponent)^k; all coefficients get one common exponent.
        common = exponent * top if exponent < 0 else 0
        numbers, power = [], 1
        for k, x in enumerate(self.numbers):
            numbers.append(x * power << (exponent * k - common))
            power *= number
        return ExactPolynomial(numbers, self.exponent + common)._reduced()

    def composed(self, inner: ExactPolynomial) -> ExactPolynomial:
        """Return the polynomial p(inner(u))."""
        return self.combined(inner.powers(len(self.numbers) - 1))

    def powers(self, degree: int) -> list[ExactPolynomial]:
        """Return the powers of the polynomial from 0 to `degree`."""
        found = [ExactPolynomial([1])]
        while len(found) <= degree:
            found.append(found[-1] * self if len(found) > 1 else self)
        return found

    def combined(self, powers: list[ExactPolynomial]) -> ExactPolynomial:
        """Return Σ c_k·powers[k], with the coefficients c_k of the polynomial: p(inner(u)) for the powers of inner."""
        own = powers[: len(self.numbers)]
        exponent = min(p.exponent for p in own)
        numbers = [0] * max(len(p.numbers) for p in own)
        for c, p in zip(self.numbers, own, strict=True):
            factor = c << (p.exponent - exponent)
            for k, x in enumerate(p.numbers):
                numbers[k] += factor * x
        return ExactPolynomial(numbers, self.exponent + exponent)

    def restricted(self, start: float, end: float) -> ExactPolynomial:
        """Return the polynomial p(start + (end − start)·u), whose values on [0, 1] are those of p on [start, end]."""
        low = ExactPolynomial.of(start)
        return self.composed(low + (ExactPolynomial.of(end) - low) * ExactPolynomial([0, 1]))

    def reflected(self) -> ExactPolynomial:
        """Return the polynomial p(1 − u)."""
        numbers = list(self.numbers)
        for k in range(len(numbers) - 1):  # the Taylor coefficients about u = 1, by repeated synthetic division
            for i in range(len(numbers) - 2, k - 1, -1):
                numbers[i] += numbers[i + 1]
        return ExactPolynomial([-x if k % 2 else x for k, x in enumerate(numbers)], self.exponent)

    def divided_by_power(self, order: int) -> ExactPolynomial:
        """Return p(u)/u^order; the coefficients of lower powers are discarded."""
        return ExactPolynomial(self.numbers[order:] or [0], self.exponent)

    def integers(self) -> list[int]:
        """Return integer coefficients of a positive multiple of the polynomial, not all even, without leading zeros."""
        numbers = list(self._reduced().numbers)
        while len(numbers) > 1 and not numbers[-1]:
            numbers.pop()
        return numbers

    def floats(self) -> list[float]:
        """Return the coefficients, each rounded once."""
        if self.exponent >= 0:
            return [float(x << self.exponent) for x in self.numbers]
        return [x / (1 << -self.exponent) for x in self.numbers]

    def _reduced(self) -> ExactPolynomial:
        """Return the same polynomial with the largest possible exponent, which keeps products small."""
        common = 0
        for x in self.numbers:
            common |= x
        zeros = (common & -common).bit_length() - 1
        if zeros <= 0:
            return self
        return ExactPolynomial([x >> zeros for x in self.numbers], self.exponent + zeros)


def _product(a: list[int], b: list[int]) -> list[int]:
    """Return the coefficients of the product of two polynomials."""
    if len(a) > len(b):
        a, b = b, a
    if len(a) >= MANY:
        return _packed_product(a, b)
    result = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        if x:
            for j, y in enumerate(b, start=i):
                result[j] += x * y
    return result


def _packed_product(a: list[int], b: list[int]) -> list[int]:
    """Return the same by one multiplication of long integers, whose digits are the coefficients (Kronecker)."""
    bits = _magnitude(a) + _magnitude(b) + len(a).bit_length() + 2
    width = -(-bits // 8)
    half = 1 << (8 * width - 1)
    count = len(a) + len(b) - 1
    # Digits are stored as digit + half, which is not negative.
    digits = (_packed(a, width, half) * _packed(b, width, half) + _repeated(half, width, count)).to_bytes(
        width * count, "little"
    )
    return [int.from_bytes(digits[k * width : (k + 1) * width], "little") - half for k in range(count)]


def _packed(a: list[int], width: int, half: int) -> int:
    """Return Σ a_k·2^(8·width·k)."""
    digits = b"".join((x + half).to_bytes(width, "little") for x in a)
    return int.from_bytes(digits, "little") - _repeated(half, width, len(a))


def _repeated(half: int, width: int, count: int) -> int:
    return int.from_bytes(half.to_bytes(width, "little") * count, "little")


def _magnitude(a: list[int]) -> int:
    return max(max(a), -min(a)).bit_length()
