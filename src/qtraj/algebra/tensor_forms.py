"""Bernstein coefficients of polynomials in the time u and in parameters, each in [0, 1].

Let a polynomial have the degree d in a parameter. Its d + 1 values at fixed nodes determine it, and so its Bernstein
coefficients, by a linear map. So no polynomials in several variables are multiplied: at the nodes, they are polynomials
in u alone, whose coefficients follow from the same formulas as for one path. A *form* is an array of coefficients, with
one axis for u and one for each parameter, and a bound on their errors. The numbers are floats, or Python integers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.bounded import SLACK, TINY, UNIT, BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial

FINENESS = 2**14
"""The nodes are multiples of 1/FINENESS, so that exact numbers at the nodes stay short."""

PRECISION, MATRIX_BITS = 320, 256
"""Number of bits of the largest integer in a form, and of the fractions of the matrices to Bernstein coefficients.

What is cut off is part of the bounds on the errors, which are about 2^-200 of the largest coefficient.
"""


ROUNDED_BITS = 900
"""Number of bits of the largest integer that is converted to a float."""


class Form(NamedTuple):
    """Bernstein coefficients with one axis for each variable, and a bound on their errors."""

    numbers: np.ndarray
    error: Any

    def corners(self) -> np.ndarray:
        """Return the values at the corners (2, 2, …)."""
        return self.numbers[np.ix_(*[(0, -1) for _ in self.numbers.shape])]

    def rounded(self) -> Form:
        """Return a form of integers in floats."""
        shift = _bits(self.numbers) - ROUNDED_BITS
        b = (self.numbers >> shift if shift > 0 else self.numbers).astype(float)
        return Form(b, float((self.error >> max(shift, 0)) + 2) + np.abs(b).max() * (SLACK * UNIT))

    def halved(self, axis: int) -> tuple[Form, Form]:
        """Return the forms on both halves of the range of one variable (de Casteljau)."""
        row = np.moveaxis(self.numbers, axis, 0)
        left, right, terms = np.empty_like(row), np.empty_like(row), len(row)
        exact = row.dtype == object
        for k in range(terms):
            left[k], right[terms - 1 - k] = row[0], row[-1]
            total: Any = row[:-1] + row[1:]
            row = total >> 1 if exact else 0.5 * total
        error = self.error + (terms - 1 if exact else np.abs(self.numbers).max() * (SLACK * UNIT * terms))
        return Form(np.moveaxis(left, 0, axis), error), Form(np.moveaxis(right, 0, axis), error)


@lru_cache
def nodes(degree: int) -> tuple[Fraction, ...]:
    """Return degree + 1 nodes in [0, 1], which are dense at the ends, as those of Chebyshev and Lobatto are."""
    angles = [math.pi * k / max(degree, 1) for k in range(degree + 1)]
    return tuple(Fraction(round(FINENESS * (1 - math.cos(x)) / 2), FINENESS) for x in angles)


@lru_cache
def _from_values(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix from the values at the nodes to Bernstein coefficients, in floats and in integers.

    The integers are 2^MATRIX_BITS times the exact matrix, rounded.
    """
    at = nodes(degree)
    columns = []
    for i, x in enumerate(at):  # the polynomial that is 1 at the node i and 0 at the others
        power = [Fraction(1)]
        for j, y in enumerate(at):
            if j != i:
                scale = 1 / (x - y)
                shifted = [Fraction(0), *power]
                power = [scale * (a - y * b) for a, b in zip(shifted, [*power, Fraction(0)], strict=True)]
        weighted = [c / math.comb(degree, k) for k, c in enumerate(power)]
        columns.append([sum(math.comb(k, j) * weighted[j] for j in range(k + 1)) for k in range(degree + 1)])
    exact = np.array(columns, object).T
    integers = np.array([[round(x * 2**MATRIX_BITS) for x in row] for row in exact], object)
    return exact.astype(float), integers


def in_floats(polynomial: BoundedPolynomial, degrees: Sequence[int]) -> Form:
    """Return the form of a polynomial with its values at the nodes as columns; the last parameter changes fastest."""
    values, errors = polynomial.bernstein()
    shape = [len(values), *(d + 1 for d in degrees)]
    b, e = values.reshape(shape), errors.reshape(shape)
    size = np.abs(b) * (SLACK * UNIT * sum(d + 4 for d in degrees)) + e
    for axis, degree in enumerate(degrees, start=1):
        matrix = _from_values(degree)[0]
        b, size = _applied(matrix, b, axis), _applied(np.abs(matrix), size, axis)
    return Form(b, SLACK * size.max() + TINY)


def in_integers(polynomials: Sequence[ExactPolynomial], degrees: Sequence[int]) -> Form:
    """Return the form of a positive multiple of a polynomial with these values at the nodes, in the same order."""
    exponent, terms = min(p.exponent for p in polynomials), max(len(p.numbers) for p in polynomials)
    rows = [[x << (p.exponent - exponent) for x in p.numbers] + [0] * (terms - len(p.numbers)) for p in polynomials]
    b = np.array(rows, object).T.reshape([terms, *(d + 1 for d in degrees)])
    b, e = _cut(_applied(_to_bernstein(terms - 1), b, 0), 0)
    for axis, degree in enumerate(degrees, start=1):
        matrix = _from_values(degree)[1]
        largest = max(int(b.max()), -int(b.min()))
        # Each row of the matrix multiplies the errors; its own roundings are at most 1/2 each.
        e = int(np.abs(matrix).sum(axis=1).max()) * e + (degree + 1) * (largest + e)
        b, e = _cut(_applied(matrix, b, axis), e)
    return Form(b, e)


def _cut(b: np.ndarray, error: int) -> tuple[np.ndarray, int]:
    """Return numbers with `PRECISION` bits, and a bound on their errors."""
    shift = _bits(b) - PRECISION
    return (b >> shift, (error >> shift) + 2) if shift > 0 else (b << -shift, error << -shift)


def _bits(b: np.ndarray) -> int:
    return max(int(b.max()), -int(b.min())).bit_length()


@lru_cache
def _to_bernstein(degree: int) -> np.ndarray:
    """Return a positive multiple of the matrix from power coefficients to Bernstein coefficients, in integers."""
    common = math.lcm(*(math.comb(degree, k) for k in range(degree + 1)))
    weights = [common // math.comb(degree, k) for k in range(degree + 1)]
    return np.array([[math.comb(i, k) * weights[k] for k in range(degree + 1)] for i in range(degree + 1)], object)


def _applied(matrix: np.ndarray, b: np.ndarray, axis: int) -> np.ndarray:
    return np.moveaxis(np.tensordot(matrix, b, axes=(1, axis)), 0, axis)
