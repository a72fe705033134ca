"""Polynomials in floats with a bound on their rounding errors, for many polynomials at once, with NumPy.

Each coefficient has a *majorant*: the same sum of products, of absolute values. If every term of a coefficient has at
most k roundings, the error of the coefficient is at most k·u times its majorant, with the unit of round-off u, apart
from terms of second order, which `SLACK` covers. `TINY` is added to the majorants of products, so that the bound also
covers underflow. After an overflow the bounds are infinite or NaN, and nothing is decided.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.signs import Signs

UNIT = 2.0**-53
SLACK = 1.06
TINY = 2.0**-960

CONSOLIDATION = 1024
"""The factor of the number of roundings in `consolidated`."""

LEVELS = 16
"""Number of times that undecided intervals are halved; about 13 prove a limit that a tuned path almost reaches."""

MAX_OPEN = 32
"""Number of undecided intervals of one claim above which it remains open; a contact has two to four at any level."""


class BoundedPolynomial:
    """Polynomials in u with coefficients `c` (terms, n), majorants `m` (terms, n), and at most `k` roundings a term."""

    __slots__ = ("c", "k", "m")
    __array_ufunc__ = None  # an array on the left of an operator leaves the operation to this class

    def __init__(self, c: Float[np.ndarray, "terms n"], m: Float[np.ndarray, "terms n"] | None = None, k: int = 0):
        self.c, self.k = c, k
        self.m = np.abs(c) if m is None else m

    @classmethod
    def constant(cls, x: Float[np.ndarray, " n"], k: int = 0) -> BoundedPolynomial:
        """Return constant polynomials whose values have at most `k` roundings."""
        return cls(x[None], k=k)

    def __add__(self, other: Any) -> BoundedPolynomial:
        return self._sum(other, np.add)

    __radd__ = __add__

    def __sub__(self, other: Any) -> BoundedPolynomial:
        return self._sum(other, np.subtract)

    def __rsub__(self, other: Any) -> BoundedPolynomial:
        return -self + other

    def __neg__(self) -> BoundedPolynomial:
        return BoundedPolynomial(-self.c, self.m, self.k)

    def __mul__(self, other: Any) -> BoundedPolynomial:
        if isinstance(other, int):
            return BoundedPolynomial(other * self.c, abs(other) * self.m, self.k + 1)
        if not isinstance(other, BoundedPolynomial):
            return NotImplemented
        a, b = (self, other) if len(self.c) <= len(other.c) else (other, self)
        roundings = a.k + b.k + len(a.c)
        m = _convolved(a.m, b.m)
        m += TINY
        return BoundedPolynomial(_convolved(a.c, b.c), m, roundings)

    __rmul__ = __mul__

    def derivative(self) -> BoundedPolynomial:
        """Return the derivative with respect to u."""
        if len(self.c) == 1:
            return BoundedPolynomial(np.zeros_like(self.c), np.zeros_like(self.m))
        powers = np.arange(1.0, len(self.c))[:, None]
        return BoundedPolynomial(self.c[1:] * powers, self.m[1:] * powers, self.k + 1)

    def composed(self, inner: BoundedPolynomial) -> BoundedPolynomial:
        """Return the polynomials p(inner(u)), by Horner's rule."""
        rows = zip(self.c[:, None], self.m[:, None], strict=True)
        *lower, result = (BoundedPolynomial(c, m, self.k) for c, m in rows)
        for c in reversed(lower):
            result = result * inner + c
        return result

    def consolidated(self) -> BoundedPolynomial:
        """Return the same polynomials and bounds, with more roundings and majorants near the sizes of the coefficients.

        In a power pⁿ, the ratio of majorant to coefficient is raised to n, but the number of roundings is only
        multiplied by n. So powers of polynomials whose terms cancel have smaller bounds.
        """
        return BoundedPolynomial(self.c, np.abs(self.c) + self.m / CONSOLIDATION, CONSOLIDATION * self.k)

    def restricted(self, start: Float[np.ndarray, " n"], end: Float[np.ndarray, " n"]) -> BoundedPolynomial:
        """Return the polynomials p(start + (end − start)·u), 0 ≤ start ≤ end ≤ 1, by repeated synthetic division."""
        terms, width = len(self.c), end - start
        c, m = self.c.copy(), self.m.copy()
        for k in range(terms - 1):  # the Taylor coefficients about the start
            for i in range(terms - 2, k - 1, -1):
                c[i] += start * c[i + 1]
                m[i] += start * m[i + 1]
        power = np.ones_like(width)
        for k in range(1, terms):
            power = power * width
            c[k] *= power
            m[k] *= power
        # Each step multiplies and adds; the width has one rounding, and its powers two more each.
        return BoundedPolynomial(c, m + TINY, self.k + 5 * terms)

    def bernstein(self) -> tuple[Float[np.ndarray, "terms n"], Float[np.ndarray, "terms n"]]:
        """Return the Bernstein coefficients on [0, 1], and bounds on their errors."""
        matrix = _to_bernstein(len(self.c))
        # The conversion rounds the matrix, the products and their sums.
        return matrix @ self.c, (matrix @ self.m) * (SLACK * UNIT * (self.k + len(self.c) + 3)) + TINY

    def _sum(self, other: Any, operation: Any) -> BoundedPolynomial:
        if isinstance(other, int | float):
            other = BoundedPolynomial.constant(np.full(self.c.shape[1], float(other)))
        if not isinstance(other, BoundedPolynomial):
            return NotImplemented
        m, n, k = len(self.c), len(other.c), max(self.k, other.k) + 1
        if m == n:
            return BoundedPolynomial(operation(self.c, other.c), self.m + other.m, k)
        c, sizes = np.zeros((max(m, n), self.c.shape[1])), np.zeros((max(m, n), self.c.shape[1]))
        c[:m], sizes[:m] = self.c, self.m
        c[:n] = operation(c[:n], other.c)
        sizes[:n] += other.m
        return BoundedPolynomial(c, sizes, k)


class Decisions(NamedTuple):
    """The results of `decide`: masks of the claims that are `proved` and `refuted`; all others are open.

    `at` are points in [0, 1] at which the claims are refuted.
    """

    proved: Bool[np.ndarray, " n"]
    refuted: Bool[np.ndarray, " n"]
    at: Float[np.ndarray, " n"]


def decide(claim: AnyClaim, count: int, strict: bool = False) -> Decisions:
    """Decide for each of `count` claims whether it is nonnegative on [0, 1], or positive if `strict`.

    The method is the same as in `subdivision.decide`, for all claims at once. What it decides is rigorous; claims that
    remain open are too close to the limit for floats.
    """
    refuted, still_open, at = np.zeros(count, bool), np.zeros(count, bool), np.zeros(count)
    owners, starts, width = np.arange(count), np.zeros(count), 1.0
    with np.errstate(all="ignore"):  # after an overflow, the comparisons are false
        forms = [p.bernstein() for p in claim.polynomials]
        for level in range(LEVELS + 1):
            inside = claim.sign([_on_intervals(b, e) for b, e in forms])
            for end in (0, -1):
                value = claim.sign([_of_numbers(b[end], e[end]) for b, e in forms])
                below = np.flatnonzero(value.le if strict else value.lt)
                refuted[owners[below]], at[owners[below]] = True, starts[below] - end * width
            keep = ~(inside.gt if strict else inside.ge) & ~refuted[owners]
            still_open |= np.bincount(owners[keep], minlength=count) > MAX_OPEN
            keep &= ~still_open[owners]
            owners, starts, width = owners[keep], starts[keep], 0.5 * width
            if level == LEVELS or not owners.size:
                still_open[owners] = True
                break
            forms = [_halved(b[:, keep], e[:, keep]) for b, e in forms]
            owners, starts = np.concatenate([owners, owners]), np.concatenate([starts, starts + width])
    return Decisions(~(refuted | still_open), refuted, at)


def _on_intervals(b: np.ndarray, e: np.ndarray) -> Signs:
    """Return what the Bernstein coefficients prove about the signs on the intervals."""
    positive, negative = (b > e).all(axis=0), (b < -e).all(axis=0)
    return Signs(positive, negative, positive, negative)


def _of_numbers(x: np.ndarray, e: np.ndarray) -> Signs:
    positive, negative = x > e, x < -e
    return Signs(positive, negative, positive, negative)


def _halved(b: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Bernstein coefficients on both halves of all intervals, the left halves first, with error bounds.

    The errors of means are at most the means of the errors, so the bounds are halved like the coefficients.
    """
    terms, count = b.shape
    # `SLACK` covers the rounding of the bounds.
    rounding = np.abs(b).max(axis=0) * (SLACK * UNIT * terms)
    return _divided(b, terms, count), _divided(e, terms, count) + np.concatenate([rounding, rounding])


def _divided(row: np.ndarray, terms: int, count: int) -> np.ndarray:
    """Return the Bernstein coefficients on both halves of all intervals (de Casteljau)."""
    result = np.empty((terms, 2 * count))
    for k in range(terms):
        result[k, :count], result[terms - 1 - k, count:] = row[0], row[-1]
        row = 0.5 * (row[:-1] + row[1:])
    return result


def _convolved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the coefficients of the products of polynomials (p, n) and (q, n), p ≤ q."""
    result = np.zeros((len(a) + len(b) - 1, b.shape[1]))
    for i, row in enumerate(a):
        result[i : i + len(b)] += row * b
    return result


@lru_cache
def _to_bernstein(terms: int) -> np.ndarray:
    """Return the matrix from power coefficients on [0, 1] to Bernstein coefficients; no entry exceeds 1."""
    n = terms - 1
    return np.array([[comb(i, k) / comb(n, k) if k <= i else 0.0 for k in range(terms)] for i in range(terms)])
