"""Polynomials on [0, 1] in Bernstein form, with a bound on their rounding.

p(u) = Σ c_k C(n,k) u^k (1−u)^{n−k}. The coefficients enclose the values: min c ≤ p(u) ≤ max c. Every operation here
also bounds what rounding and the errors of its operands can have done to any of its coefficients, so that a sign that
is read off holds for the exact polynomial of the exact input. Products in this form are convex combinations of products
of coefficients: their errors do not grow with the degree as those of powers of u do.

Two bounds are kept to: `count` roundings change a sum of products by at most `count` units of round-off of the sum of
the magnitudes, in any order of summation; and a bound itself is computed with some slack for its own rounding.
"""

import math
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, ScalarLike

SLACK = 1 + 2.0**-40
"""A bound is raised by this factor, for its own rounding."""


class Bernstein(eqx.Module):
    """Polynomials of degree n by `coefficients` (..., n+1), each coefficient within `error` of the exact one.

    Several in one share an error bound: the three components of a vector, say.
    """

    coefficients: Float[Array, "*many _"]
    error: Scalar

    @property
    def degree(self) -> int:
        """The degree of the form, which may exceed that of the polynomial."""
        return self.coefficients.shape[-1] - 1

    @property
    def size(self) -> Scalar:
        """The largest magnitude of a computed coefficient."""
        return jnp.max(jnp.abs(self.coefficients))

    def __getitem__(self, index: Any) -> "Bernstein":
        """Some of several polynomials."""
        return Bernstein(self.coefficients[index], self.error)

    def __add__(self, other: "Bernstein") -> "Bernstein":
        p, q = _alike(self, other)
        return Bernstein(p.coefficients + q.coefficients, _after(p.error + q.error, 1, p.size + q.size))

    def __sub__(self, other: "Bernstein") -> "Bernstein":
        p, q = _alike(self, other)
        return Bernstein(p.coefficients - q.coefficients, _after(p.error + q.error, 1, p.size + q.size))

    def __mul__(self, other: "Bernstein") -> "Bernstein":
        p, q = (self, other) if self.degree <= other.degree else (other, self)
        inherited = p.size * q.error + q.size * p.error + p.error * q.error
        return Bernstein(_product(p.coefficients, q.coefficients), _after(inherited, p.degree + 6, p.size * q.size))

    def scaled(self, factor: ScalarLike, error: ScalarLike = 0.0) -> "Bernstein":
        """The polynomial times a number that is known to within `error`."""
        factor = jnp.asarray(factor, self.coefficients.dtype)
        inherited = jnp.abs(factor) * self.error + error * (self.size + self.error)
        return Bernstein(factor * self.coefficients, _after(inherited, 1, jnp.abs(factor) * self.size))

    def elevated(self, degree: int) -> "Bernstein":
        """The same polynomial in the form of a higher degree."""
        if degree == self.degree:
            return self
        matrix = jnp.asarray(_elevation(self.degree, degree), self.coefficients.dtype)
        return Bernstein(_applied(self.coefficients, matrix), _after(self.error, self.degree + 3, self.size))

    def derivative(self) -> "Bernstein":
        """dp/du."""
        n = self.degree
        if n == 0:
            return Bernstein(jnp.zeros_like(self.coefficients), jnp.zeros_like(self.error))
        differences = n * jnp.diff(self.coefficients, axis=-1)
        return Bernstein(differences, _after(2 * n * self.error, 2, 2 * n * self.size))

    def on(self, low: ScalarLike, high: ScalarLike) -> "Bernstein":
        """The polynomial on [low, high] ⊂ [0, 1] in the form of that interval.

        `low` and `high` must be exact in binary: then no part of [0, 1] falls between two such intervals.
        """
        n = self.degree
        matrix = _blossom(jnp.asarray(low, self.error.dtype), jnp.asarray(high, self.error.dtype), n)
        return Bernstein(_applied(self.coefficients, matrix), _after(self.error, 4 * n + n + 1, self.size))

    def at(self, u: ScalarLike) -> tuple[Array, Scalar]:
        """The values at u ∈ [0, 1], and a bound on their error."""
        n = self.degree
        u = jnp.asarray(u, self.coefficients.dtype)
        basis = _binomials(n, u.dtype) * powers(u, n) * powers(1 - u, n)[::-1]
        return _applied(self.coefficients, basis), _after(self.error, 4 * n + 8, self.size)


def dot(p: Bernstein, q: Bernstein) -> Bernstein:
    """p·q of two vectors of polynomials (3, n+1)."""
    terms = p * q
    return Bernstein(jnp.sum(terms.coefficients, axis=0), _after(3 * terms.error, 2, 3 * terms.size))


def cross(p: Bernstein, q: Bernstein) -> Bernstein:
    """p×q of two vectors of polynomials (3, n+1)."""
    after, before = jnp.array([1, 2, 0]), jnp.array([2, 0, 1])
    return p[after] * q[before] - p[before] * q[after]


def stacked(*polynomials: Bernstein) -> Bernstein:
    """Several polynomials in one, in the highest of their degrees."""
    degree = max(p.degree for p in polynomials)
    alike = [p.elevated(degree) for p in polynomials]
    return Bernstein(jnp.stack([p.coefficients for p in alike]), jnp.max(jnp.stack([p.error for p in alike])))


def constant(value: Scalar) -> Bernstein:
    """An exact constant."""
    return Bernstein(value[None], jnp.zeros_like(value))


def from_ascending(coefficients: Float[Array, " n"], error: ScalarLike = 0.0) -> Bernstein:
    """The polynomial Σ a_k u^k on [0, 1], each a_k within `error`. For low degrees only: powers are ill-conditioned."""
    n = coefficients.shape[0] - 1
    matrix = jnp.asarray(_conversion(n), coefficients.dtype)
    total = jnp.sum(jnp.abs(coefficients))
    error = jnp.asarray(error, coefficients.dtype)
    return Bernstein(_applied(coefficients, matrix), _after((n + 1) * error, n + 2, total))


def powers(u: Scalar, n: int) -> Float[Array, " {n}+1"]:
    """1, u, …, u^n, by doubling: u^k after at most k roundings."""
    row = jnp.ones_like(u)[None]
    while row.shape[0] <= n:
        row = jnp.concatenate([row, row * (row[-1] * u)])
    return row[: n + 1]


def _after(inherited: Scalar, count: int, size: Scalar) -> Scalar:
    """An error bound after `count` more roundings of quantities of this size."""
    limits = jnp.finfo(size.dtype)
    return (inherited + count * float(limits.eps) * size) * SLACK + (count + 1) * float(limits.tiny)  # underflow


def _alike(p: Bernstein, q: Bernstein) -> tuple[Bernstein, Bernstein]:
    degree = max(p.degree, q.degree)
    return p.elevated(degree), q.elevated(degree)


def _applied(coefficients: Float[Array, "*many n"], matrix: Array) -> Array:
    return jnp.matmul(coefficients, matrix, precision="highest")


def _product(p: Float[Array, "*many m"], q: Float[Array, "*many n"]) -> Array:
    """Σ_{i+j=k} C(m,i)C(n,j)/C(m+n,k) p_i q_j, as shifted copies of the longer factor."""
    m, n = p.shape[-1] - 1, q.shape[-1] - 1
    many = p.ndim - 1
    p, q = p * _row_of(_binomials(m, p.dtype), many), q * _row_of(_binomials(n, q.dtype), many)
    terms = [jnp.pad(p[..., i, None] * q, [*([(0, 0)] * many), (i, m - i)]) for i in range(m + 1)]
    return sum(terms[1:], terms[0]) / _row_of(_binomials(m + n, p.dtype), many)


def _row_of(x: Float[Array, " n"], many: int) -> Array:
    return x[(None,) * many]


def _blossom(low: Scalar, high: Scalar, n: int) -> Float[Array, "{n}+1 {n}+1"]:
    """Coefficients on [0, 1] times this matrix are those on [low, high]: of column k, k arguments are `high`."""
    start = jnp.eye(n + 1, dtype=low.dtype)
    columns = [start]
    for _ in range(n):
        columns = [_between(columns[0], low), *(_between(column, high) for column in columns)]
    return jnp.concatenate(columns, axis=1)


def _between(rows: Array, u: Scalar) -> Array:
    return (1 - u) * rows[:, :-1] + u * rows[:, 1:]


def _binomials(n: int, dtype: np.dtype) -> Float[Array, " {n}+1"]:
    return jnp.asarray(_row(n), dtype)


@cache
def _row(n: int) -> tuple[float, ...]:
    return tuple(float(math.comb(n, k)) for k in range(n + 1))


@cache
def _conversion(n: int) -> np.ndarray:
    """b_i = Σ_k C(i,k)/C(n,k) a_k, as a matrix to multiply from the right."""
    return np.array([[math.comb(i, k) / math.comb(n, k) for i in range(n + 1)] for k in range(n + 1)])


@cache
def _elevation(n: int, to: int) -> np.ndarray:
    """b_k = Σ_i C(n,i)C(to−n,k−i)/C(to,k) c_i, as a matrix to multiply from the right."""
    extra = to - n
    entry = [
        [math.comb(n, i) * math.comb(extra, k - i) if 0 <= k - i <= extra else 0 for k in range(to + 1)]
        for i in range(n + 1)
    ]
    return np.array([[entry[i][k] / math.comb(to, k) for k in range(to + 1)] for i in range(n + 1)])
