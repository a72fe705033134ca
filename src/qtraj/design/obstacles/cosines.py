"""Enclosures of cosine and sine in integers, by Taylor polynomials with a bound on the remainder."""

from __future__ import annotations

import math
from fractions import Fraction

from qtraj.algebra.exact import ExactPolynomial

BITS = 200
"""Bits after the binary point."""

ORDER = 9
"""The order of the Taylor polynomials of cosine (one less) and sine."""


def cos_and_sin(x: float) -> tuple[Fraction, Fraction, Fraction]:
    """Return dyadic approximations of cos x and sin x, and a bound on the errors of both.

    The angle is halved until it is below 1/2. There the Taylor series is summed with `BITS` bits, and each term is
    rounded by less than one unit of the last bit. Each doubling (cos 2x = 2cos²x − 1, sin 2x = 2 sin x cos x) makes an
    error e at most 4e + 2e² plus roundings, which is at most 5e plus roundings for e ≤ 1/2.
    """
    halvings = max(0, math.frexp(x)[1] + 1)
    one = 1 << BITS
    small = Fraction(x) / (1 << halvings)
    angle = (small.numerator << BITS) // small.denominator  # an error of one unit
    cos, sin, term, k = one, 0, one, 0
    while term:
        k += 1
        term = abs(term) * abs(angle) // (one * k)
        if k % 2:
            sin += term if k % 4 == 1 else -term
        else:
            cos += -term if k % 4 == 2 else term
    sin, error = (sin if angle >= 0 else -sin), 2 * k + 4
    for _ in range(halvings):
        cos, sin = (2 * cos * cos >> BITS) - one, 2 * sin * cos >> BITS
        error = 5 * error + 2
        if 2 * error >= one:  # a huge angle: only that both are at most 1 is known
            return Fraction(0), Fraction(0), Fraction(1)
    return Fraction(cos, one), Fraction(sin, one), Fraction(error, one)


def taylor(angle: ExactPolynomial, size: Fraction) -> tuple[ExactPolynomial, ExactPolynomial, Fraction]:
    """Return polynomials near the cosine and the sine of an angle of at most `size`, and a bound on their errors.

    The coefficients 1/k! are rounded to dyadic numbers.
    """
    cos, sin, powers, error = ExactPolynomial([0]), ExactPolynomial([0]), angle.powers(ORDER), Fraction(0)
    for k in range(ORDER + 1):
        coefficient = Fraction((1 << BITS) // math.factorial(k), 1 << BITS)
        error += Fraction(1, 1 << BITS) * size**k
        term = powers[k] * ExactPolynomial.of((-1) ** (k // 2) * coefficient)
        if k % 2:
            sin = sin + term
        else:
            cos = cos + term
    return cos, sin, error + size ** (ORDER + 1) / math.factorial(ORDER + 1)
