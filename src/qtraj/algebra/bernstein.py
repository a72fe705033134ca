"""Polynomials in Bernstein form with rigorous error bounds, for many polynomials at once, with NumPy.

A polynomial on [0, 1] lies between its smallest and its largest Bernstein coefficient. Each coefficient of a product is
a weighted mean of products of coefficients, so its magnitude does not exceed the product of the largest magnitudes. The
sum of these bounds is a bound M on a sum of products. If each term has at most `count` roundings, the rounding error of
the sum is at most `count` units of round-off times M. As in `chebyshev_model`, every bound is multiplied by `SLACK` to
cover its own rounding, `TINY` is added to every error to cover underflow, and every `size` is at least `MIN_SIZE`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

EPS = float(np.finfo(float).eps)
"""Twice the unit of round-off."""

SLACK = 1 + 2.0**-40
TINY = 2.0**-1000
MIN_SIZE = 2.0**-960

MAX_DEGREE = 56
"""The largest degree whose binomial coefficients are exact in float64; products of higher degree have no bounds."""


class Bernstein(NamedTuple):
    """Polynomials whose coefficients differ from `values` by at most `error`; no |value| exceeds `size`.

    `values` (*vector, k, n) are the coefficients of n polynomials of degree k − 1; `size` and `error` (n,) apply to all
    components of a vector. If a bound is infinite or NaN, the polynomial has no bound.
    """

    values: Float[np.ndarray, "*vector k n"]
    size: Float[np.ndarray, " n"]
    error: Float[np.ndarray, " n"]

    @property
    def lower(self) -> Float[np.ndarray, " n"]:
        """A lower bound on each polynomial on [0, 1]; it is not finite if the polynomial has no bound."""
        return self.values.min(axis=-2) - self.error * SLACK

    @property
    def positive(self) -> Bool[np.ndarray, " n"]:
        """Whether each polynomial is proved to be positive on [0, 1]."""
        return self.values.min(axis=-2) > self.error * SLACK

    def part(self, index: Any) -> Bernstein:
        """Return the selected components of a vector."""
        return Bernstein(self.values[index], self.size, self.error)

    def one(self) -> Bernstein:
        """Return the constant 1."""
        return Bernstein(np.ones((1, self.values.shape[-1])), np.ones_like(self.size), np.zeros_like(self.error))


class Polynomials:
    """`Bernstein` polynomials, or vectors of polynomials, with the operations that the formulas in `frenet` use."""

    def __init__(self, form: Bernstein):
        """Wrap polynomials, or vectors of them, in Bernstein form."""
        self.form = form

    def __getitem__(self, index: Any) -> Polynomials:
        return Polynomials(self.form.part(index))

    def __mul__(self, other: Polynomials) -> Polynomials:
        return Polynomials(_of_products([[(self.form.values, other.form.values)]], self.form, other.form, None))

    def __matmul__(self, other: Polynomials) -> Polynomials:
        pairs = [*zip(self.form.values, other.form.values, strict=True)]
        return Polynomials(_of_products([pairs], self.form, other.form, None))

    def cross(self, other: Polynomials) -> Polynomials:
        """Return the vector product of two vectors (3,)."""
        p, q = self.form.values, other.form.values
        pairs = [[(p[j], q[k]), (-p[k], q[j])] for j, k in ((1, 2), (2, 0), (0, 1))]
        return Polynomials(_of_products(pairs, self.form, other.form, 3))

    def __add__(self, other: Polynomials) -> Polynomials:
        p, q = _elevated(self.form, other.form)
        size = (p.size + q.size) * SLACK
        return Polynomials(Bernstein(p.values + q.values, size, add_rounding(p.error + q.error, 1, size)))

    def __sub__(self, other: Polynomials) -> Polynomials:
        return self + -1 * other

    def __rmul__(self, factor: int) -> Polynomials:
        size = abs(factor) * self.form.size
        error = add_rounding(abs(factor) * self.form.error, 1, size)
        return Polynomials(Bernstein(factor * self.form.values, size * SLACK, error))

    def multiple(self, factor: Float[np.ndarray, " n"], uncertainty: Float[np.ndarray, " n"]) -> Polynomials:
        """Return each polynomial multiplied by its positive `factor`, which has the absolute `uncertainty`."""
        p = self.form
        size = factor * p.size
        inherited = factor * p.error + uncertainty * (p.size + p.error)
        return Polynomials(Bernstein(factor * p.values, size * SLACK, add_rounding(inherited, 1, size)))

    def one(self) -> Polynomials:
        """Return the constant 1."""
        return Polynomials(self.form.one())


def from_powers(coefficients: Float[np.ndarray, "*vector k n"], roundings: int) -> Polynomials:
    """Return polynomials from their ascending coefficients on [0, 1].

    `roundings` is the maximum number of relative rounding errors that each coefficient already contains.
    """
    count = coefficients.shape[-2]
    values = np.asarray(_to_bernstein(count)) @ coefficients
    sums = np.abs(coefficients).sum(axis=-2)
    size = sums.reshape(-1, sums.shape[-1]).max(axis=0) * SLACK + MIN_SIZE
    # The conversion rounds the matrix, the products and their sum: count + 2 roundings.
    return Polynomials(Bernstein(values, size, add_rounding(np.zeros_like(size), roundings + count + 2, size)))


def add_rounding(error: np.ndarray, count: int, size: np.ndarray) -> np.ndarray:
    """Return the bound `error`, increased to cover `count` more roundings of terms whose magnitudes sum to `size`."""
    return (error + count * EPS * size) * SLACK + TINY


@lru_cache
def _to_bernstein(count: int) -> np.ndarray:
    """Return the matrix that converts power coefficients on [0, 1] to Bernstein coefficients; no entry exceeds 1.

    The rows are the Bernstein coefficients, and the columns are the powers.
    """
    n = count - 1
    return np.array([[math.comb(j, k) / math.comb(n, k) for k in range(count)] for j in range(count)])


@lru_cache
def _binomials(degree: int) -> np.ndarray:
    return np.array([float(math.comb(degree, k)) for k in range(degree + 1)])[:, None]


def _of_products(pairs: list[list[tuple[np.ndarray, np.ndarray]]], p: Bernstein, q: Bernstein, axes: Any) -> Bernstein:
    """Return sums of products: a vector with `axes` components, or single polynomials if `axes` is None.

    `pairs[i]` contains the factors of each product in component i; the factors are coefficients of `p` and `q`.
    """
    m, n = p.values.shape[-2] - 1, q.values.shape[-2] - 1
    if m + n > MAX_DEGREE:
        infinite = np.full_like(p.size, np.inf)
        return Bernstein(np.zeros(((axes,) if axes else ()) + (1, p.size.size)), infinite, infinite)
    components = [sum(_convolved(a * _binomials(m), b * _binomials(n)) for a, b in terms) for terms in pairs]
    components = [component / _binomials(m + n) for component in components]
    values = np.stack(components) if axes else components[0]
    terms = len(pairs[0])
    inherited = p.size * q.error + q.size * p.error + p.error * q.error
    # Each term of a coefficient is rounded in both scaled factors, the product, the sums and the final division.
    count = min(m, n) + terms + 4
    error = add_rounding(terms * inherited, terms * count, p.size * q.size)
    magnitudes = np.abs(values).max(axis=-2)
    return Bernstein(values, magnitudes.reshape(-1, magnitudes.shape[-1]).max(axis=0) + MIN_SIZE, error)


def _convolved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the convolution of arrays (m + 1, n) and (k + 1, n) along the first axis."""
    if len(a) > len(b):
        a, b = b, a
    result = np.zeros((len(a) + len(b) - 1, a.shape[1]))
    for i, row in enumerate(a):
        result[i : i + len(b)] += row * b
    return result


def _elevated(p: Bernstein, q: Bernstein) -> tuple[Bernstein, Bernstein]:
    """Raise the lower of two degrees to the higher degree, and return both polynomials."""
    m, n = p.values.shape[-2], q.values.shape[-2]
    if m == n:
        return p, q
    low, high = (p, q) if m < n else (q, p)
    ones = np.ones((abs(m - n) + 1, p.size.size))
    one = Bernstein(ones, np.ones_like(p.size), np.zeros_like(p.size))
    raised = _of_products([[(low.values, ones)]], low, one, None)
    return (raised, high) if m < n else (high, raised)
