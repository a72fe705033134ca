"""Represent analytic functions on [−1, 1] by their values at Chebyshev nodes, with rigorous error bounds.

A model bounds the rounding errors of its values, and the function itself on ellipses about [−1, 1] in the complex
plane. The second bound limits the distance between the function and the polynomial through the values (Trefethen,
Approximation Theory and Approximation Practice, theorem 8.2). The smaller the cell that is scaled to [−1, 1], the
smaller this distance. Arithmetic operates on the values, node by node, and costs the same for polynomials of any
degree.

The bounds follow three rules. A sum of products with at most `count` roundings in each term has an error of at most
`count` units of round-off times the sum of the magnitudes of the terms. Bounds are multiplied by `SLACK` to cover the
rounding of the bounds themselves, and `TINY` is added to errors to cover underflow. `MIN_SIZE` is added to sizes to
cover underflow in an operand.

Values have the shape (*vector, node, cell, path). Cells and paths are the last axes because the vector instructions of
a CPU operate on the last axes.
"""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

NODES = 10

SLACK = 1 + 2.0**-40
TINY = 2.0**-1000
MIN_SIZE = 2.0**-960

AXIS = -3
"""The axis of the nodes and, in arrays of coefficients, of the powers of the variable s in [−1, 1]."""


def _cosine(m: np.ndarray) -> np.ndarray:
    """Return cos(mπ/2n), n = `NODES`, to one unit of round-off; the angle is first reduced in integer arithmetic."""
    n = NODES
    k = (3 * n - m) % (4 * n) - 2 * n
    k = np.where(k > n, 2 * n - k, np.where(k < -n, -2 * n - k, k))
    return np.sin(np.pi * k / (2 * n))


_ODD = 2 * np.arange(NODES) + 1
POINTS = _cosine(_ODD)
"""The nodes, which are the zeros of the Chebyshev polynomial T_n, n = `NODES`."""

TO_CHEBYSHEV = _cosine(np.outer(np.arange(NODES), _ODD)) * np.where(np.arange(NODES) == 0, 1.0, 2.0)[:, None] / NODES
"""The matrix that converts values at the nodes to the Chebyshev coefficients of the interpolating polynomial.

The rows are the coefficients, and the columns are the nodes.
"""

TO_POWERS = np.zeros((NODES, NODES))
"""The matrix that converts Chebyshev coefficients (columns) to coefficients of powers of s (rows).

Its entries are integers.
"""
for _k, _unit in enumerate(np.eye(NODES)):
    _powers = np.polynomial.chebyshev.cheb2poly(_unit)
    TO_POWERS[: _powers.size, _k] = _powers

LEBESGUE = 3.0
"""A bound on max|p| / max|values|, where p is the interpolating polynomial, and max|p| its maximum on [−1, 1]."""

SEMI_AXES, MIN_LAST_SEMI_AXIS = (3.0, 6.0), 16.0
"""Semi-major axes of the first two ellipses, and the minimum semi-major axis of the last ellipse, about [−1, 1].

`cells.semi_axes` enlarges the last ellipse in small cells.
"""

INTERPOLATION_FACTOR = 4 / 1.6 / 1.94 ** (NODES - 1)
"""Upper bound on a^NODES times the factor 4/((ρ − 1) ρ^(NODES−1)) of theorem 8.2.

a is the semi-major axis of an ellipse, and ρ is the sum of its semi-axes. Since a ≥ 3, ρ > 1.94 a and ρ − 1 > 1.6 a.
"""


class ChebyshevModel(eqx.Module):
    """Functions f, represented by `values` at the nodes, with error bounds.

    At the nodes, |value − f| ≤ `error` and |value| ≤ `size`; on the ellipses, |f| ≤ `bound`. The components of a vector
    share the three bounds. Theorem 8.2 is stated for nodes at the extrema of the Chebyshev polynomial T_n, n = `NODES`.
    It also applies to nodes at the zeros of T_n, because at either set of nodes every T_k with k > n has, up to sign,
    the same values as some T_j with j ≤ n.
    """

    values: Float[Array, "*vector node cells paths"]
    size: Float[Array, "cells paths"]
    error: Float[Array, "cells paths"]
    bound: Float[Array, "ellipses cells paths"]

    def __getitem__(self, index: Any) -> "ChebyshevModel":
        """Return the selected components of a vector."""
        return ChebyshevModel(self.values[index], self.size, self.error, self.bound)

    def __add__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        return _sum(self, other)

    def __sub__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        return _sum(self, -1 * other)

    def __mul__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        return _product(self, other)

    def __matmul__(self, other: "ChebyshevModel") -> "ChebyshevModel":
        """Return the scalar product of two vectors."""
        return _dot(self, other)

    def cross(self, other: "ChebyshevModel") -> "ChebyshevModel":
        """Return the vector product of two vectors (3,)."""
        return _cross(self, other)

    def __rmul__(self, factor: int) -> "ChebyshevModel":
        """Return the product with an integer; a power of two adds no rounding error."""
        return _integer_multiple(factor, self)

    def one(self) -> "ChebyshevModel":
        """Return the constant 1 as a model in the same cells."""
        return _one(self)


@partial(jax.jit, static_argnums=0)
def _integer_multiple(factor: int, p: ChebyshevModel) -> ChebyshevModel:
    size, error, bound = (abs(factor) * x for x in (p.size, p.error, p.bound))
    if abs(factor) & (abs(factor) - 1):
        size, error, bound = size * SLACK, add_rounding(error, 1, size), bound * SLACK
    return ChebyshevModel(factor * p.values, size, error, bound)


@jax.jit
def _one(p: ChebyshevModel) -> ChebyshevModel:
    ones = jnp.ones_like(p.error)
    return ChebyshevModel(jnp.ones_like(p.values), ones, 0.0 * ones, jnp.ones_like(p.bound))


@jax.jit
def multiple(p: ChebyshevModel, factor: Float[Array, "1 paths"], error: Float[Array, "1 paths"]) -> ChebyshevModel:
    """Return `p` multiplied by a positive `factor` with the absolute uncertainty `error`."""
    size, bound = factor * p.size, (factor + error)[None] * p.bound * SLACK
    rounding = add_rounding(factor * p.error + error * (p.size + p.error), 1, size)
    return ChebyshevModel(factor[None] * p.values, size * SLACK, rounding, bound)


@jax.jit
def interpolated(p: ChebyshevModel, semi_axes: Float[Array, "ellipses cells paths"]) -> tuple[Array, Array]:
    """Return the coefficients (k, cells, paths) of the interpolating polynomial Σ c_k s^k, and a bound on its error.

    The bound is valid on [−1, 1]. `semi_axes` are the semi-major axes of the ellipses to which `p.bound` refers.
    """
    eps = float(np.finfo(p.values.dtype).eps)
    a = _apply(TO_CHEBYSHEV, p.values)
    # The coefficient of T_k is a sum of terms that are at most 2/NODES · max|values|; each has NODES + 2 roundings. The
    # nodes are rounded too, which changes a value by half a unit of round-off times the slope. Bernstein's inequality
    # bounds the slope by 340 max|values|.
    rounding = eps * 4 * NODES**2 * max_abs(p.values)
    weights = jnp.asarray(np.sum(np.abs(TO_POWERS), axis=0), a.dtype)[:, None, None]
    conversion = eps * NODES * jnp.sum(weights * jnp.abs(a), axis=0)
    interpolation = jnp.min(INTERPOLATION_FACTOR * jax.lax.integer_pow(1 / semi_axes, NODES) * p.bound, axis=0)
    return _apply(TO_POWERS, a), (LEBESGUE * p.error + rounding + conversion + interpolation) * SLACK + TINY


def add_rounding(error: Array, count: float | Array, size: Array) -> Array:
    """Return the bound `error`, increased to cover `count` more roundings of terms whose magnitudes sum to `size`."""
    return (error + count * float(np.finfo(size.dtype).eps) * size) * SLACK + TINY


def max_abs(values: Array) -> Float[Array, "cells paths"]:
    """Return the largest magnitude of the values in each cell of each path, increased by `MIN_SIZE`."""
    return jnp.max(jnp.abs(values), axis=tuple(range(values.ndim - 2))) + MIN_SIZE


def _products(values: Array, p: ChebyshevModel, q: ChebyshevModel, terms: int) -> ChebyshevModel:
    """Return the model with these values, each a sum of `terms` products of components of `p` and `q`."""
    inherited, size = p.size * q.error + q.size * p.error + p.error * q.error, p.size * q.size
    error = add_rounding(terms * inherited, terms * terms, size)
    size = size * SLACK + MIN_SIZE if terms == 1 else max_abs(values)
    return ChebyshevModel(values, size, error, terms * p.bound * q.bound * SLACK)


@jax.jit
def _dot(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    terms = p.values * q.values
    values = terms[0]
    for term in terms[1:]:
        values = values + term
    return _products(values, p, q, terms.shape[0])


@jax.jit
def _cross(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    (px, py, pz), (qx, qy, qz) = p.values, q.values
    return _products(jnp.stack([py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx]), p, q, 2)


@jax.jit
def _product(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    return _products(p.values * q.values, p, q, 1)


@jax.jit
def _sum(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    size = (p.size + q.size) * SLACK
    return ChebyshevModel(
        p.values + q.values, size, add_rounding(p.error + q.error, 1, size), (p.bound + q.bound) * SLACK
    )


def _apply(matrix: np.ndarray, x: Float[Array, "k cells paths"]) -> Float[Array, "k cells paths"]:
    return jnp.tensordot(jnp.asarray(matrix, x.dtype), x, 1, precision="highest")
