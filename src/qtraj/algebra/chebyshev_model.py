"""Analytic functions on [−1, 1] by their values at Chebyshev nodes, with bounds that turn the values into proofs.

A model bounds what rounding did to its values, and the function itself on ellipses about [−1, 1] in the complex
plane: by that the polynomial through the values differs from the function by next to nothing (Trefethen, Approximation
Theory and Approximation Practice, theorem 8.2), and the less, the smaller the interval is on which the function was
taken. So arithmetic is that of numbers, node by node, whatever the degree of the polynomials that are multiplied.

Three bounds are kept to. A sum of products with at most `count` roundings in any of its terms is off by at most `count`
units of round-off of the sum of the magnitudes. A bound is raised by `SLACK` for its own rounding, and an error by
`TINY` for underflow. A size is never below `FLOOR`, so that what underflowed in an operand is accounted for, too.

Values are (*vector, node, cell, path): the cells and paths that are worked on together stand last, where one
instruction of the processor takes several of them.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

NODES = 10

SLACK = 1 + 2.0**-40
TINY = 2.0**-1000
FLOOR = 2.0**-960

AXIS = -3
"""That of the nodes, and of the powers of s in coefficients."""


def _cosine(m: np.ndarray) -> np.ndarray:
    """cos(mπ/2n) to within a unit of round-off, by the sine of an angle reduced in whole numbers."""
    n = NODES
    k = (3 * n - m) % (4 * n) - 2 * n
    k = np.where(k > n, 2 * n - k, np.where(k < -n, -2 * n - k, k))
    return np.sin(np.pi * k / (2 * n))


_ODD = 2 * np.arange(NODES) + 1
POINTS = _cosine(_ODD)
"""The nodes, the zeros of T_n."""

TO_CHEBYSHEV = _cosine(np.outer(np.arange(NODES), _ODD)) * np.where(np.arange(NODES) == 0, 1.0, 2.0)[:, None] / NODES
"""From the values to the coefficients of T_0 … of the polynomial through them."""

TO_POWERS = np.zeros((NODES, NODES))
"""From these to the coefficients of powers of s; whole numbers."""
for _k, _unit in enumerate(np.eye(NODES)):
    _powers = np.polynomial.chebyshev.cheb2poly(_unit)
    TO_POWERS[: _powers.size, _k] = _powers

LEBESGUE = 3.0
"""The polynomial through values exceeds their largest magnitude by less than this factor."""

REACHES, LONGEST = (3.0, 6.0), 16.0
"""Long semi-axes of ellipses; the last may be longer, where the interval is small."""

ELSEWHERE = 4 / 1.6 / 1.94 ** (NODES - 1)
"""The theorem's 4/(ρ − 1)/ρ^(NODES−1) is below this over reach^NODES: ρ > 1.94 · reach, and ρ − 1 > 1.6 · reach."""


class ChebyshevModel(eqx.Module):
    """Functions by `values` within `error` of the exact ones, of magnitudes up to `size`, on ellipses up to `bound`.

    The components of a vector share all three. The theorem holds at the zeros of T_n, too: of the terms above n each
    takes the values of one below, up to its sign, at either kind of nodes.
    """

    values: Float[Array, "*vector node cells paths"]
    size: Float[Array, "cells paths"]
    error: Float[Array, "cells paths"]
    bound: Float[Array, "ellipses cells paths"]

    def __getitem__(self, index: Any) -> "ChebyshevModel":
        """Some components of a vector."""
        return ChebyshevModel(self.values[index], self.size, self.error, self.bound)

    def __add__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        return _sum(self, other)

    def __sub__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        return _sum(self, -1 * other)

    def __mul__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        return _product(self, other)

    def __matmul__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        """The scalar product of two vectors."""
        return _dot(self, other)

    def cross(self, other: "ChebyshevModel") -> "ChebyshevModel":
        """The vector product of two vectors (3,)."""
        return _cross(self, other)

    def __rmul__(self, factor: int) -> "ChebyshevModel":
        """Times a whole number; a power of two rounds nothing."""
        size, error, bound = (abs(factor) * x for x in (self.size, self.error, self.bound))
        if abs(factor) & (abs(factor) - 1):
            size, error, bound = size * SLACK, add_rounding(error, 1, size), bound * SLACK
        return ChebyshevModel(factor * self.values, size, error, bound)

    def one(self) -> "ChebyshevModel":
        """The constant 1 in the same cells."""
        ones = jnp.ones_like(self.error)
        return ChebyshevModel(jnp.ones_like(self.values), ones, 0.0 * ones, jnp.ones_like(self.bound))


@jax.jit
def multiple(p: ChebyshevModel, factor: Float[Array, "1 paths"], error: Float[Array, "1 paths"]) -> ChebyshevModel:
    """`p` times a positive number that is known to within `error`."""
    size, most = factor * p.size, (factor + error)[None] * p.bound * SLACK
    rounding = add_rounding(factor * p.error + error * (p.size + p.error), 1, size)
    return ChebyshevModel(factor[None] * p.values, size * SLACK, rounding, most)


@jax.jit
def interpolated(p: ChebyshevModel, reach: Float[Array, "ellipses cells paths"]) -> tuple[Array, Array]:
    """Coefficients (k, cells, paths) of a polynomial, and how far from it the function may be on [−1, 1].

    `reach` are the long semi-axes of the ellipses on which the bounds hold.
    """
    eps = float(np.finfo(p.values.dtype).eps)
    a = _applied(TO_CHEBYSHEV, p.values)
    # Of a coefficient of T_k: NODES + 2 roundings of terms below 2/NODES · size. The nodes are rounded, too: a value
    # there is off by half a unit of round-off of the slope, of which Bernstein's inequality makes 340 of the size.
    rounding = eps * 4 * NODES**2 * largest(p.values)
    weights = jnp.asarray(np.sum(np.abs(TO_POWERS), axis=0), a.dtype)[:, None, None]
    conversion = eps * NODES * jnp.sum(weights * jnp.abs(a), axis=0)
    elsewhere = jnp.min(ELSEWHERE * jax.lax.integer_pow(1 / reach, NODES) * p.bound, axis=0)
    return _applied(TO_POWERS, a), (LEBESGUE * p.error + rounding + conversion + elsewhere) * SLACK + TINY


def add_rounding(inherited: Array, count: float, size: Array) -> Array:
    """An error bound after `count` more roundings of terms whose magnitudes sum up to `size`."""
    return (inherited + count * float(np.finfo(size.dtype).eps) * size) * SLACK + TINY


def largest(values: Array) -> Float[Array, "cells paths"]:
    """The largest magnitude of a value."""
    return jnp.max(jnp.abs(values), axis=tuple(range(values.ndim - 2))) + FLOOR


def _of_products(values: Array, p: ChebyshevModel, q: ChebyshevModel, terms: int) -> ChebyshevModel:
    """Each value is a sum of so many products of components."""
    inherited, size = p.size * q.error + q.size * p.error + p.error * q.error, p.size * q.size
    error = add_rounding(terms * inherited, terms * terms, size)
    found = size * SLACK + FLOOR if terms == 1 else largest(values)
    return ChebyshevModel(values, found, error, terms * p.bound * q.bound * SLACK)


@jax.jit
def _dot(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    terms = p.values * q.values
    values = terms[0]
    for term in terms[1:]:
        values = values + term
    return _of_products(values, p, q, terms.shape[0])


@jax.jit
def _cross(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    (px, py, pz), (qx, qy, qz) = p.values, q.values
    return _of_products(jnp.stack([py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx]), p, q, 2)


@jax.jit
def _product(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    return _of_products(p.values * q.values, p, q, 1)


@jax.jit
def _sum(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    size = (p.size + q.size) * SLACK
    return ChebyshevModel(
        p.values + q.values, size, add_rounding(p.error + q.error, 1, size), (p.bound + q.bound) * SLACK
    )


def _applied(matrix: np.ndarray, x: Float[Array, "k cells paths"]) -> Float[Array, "k cells paths"]:
    return jnp.tensordot(jnp.asarray(matrix, x.dtype), x, 1, precision="highest")
