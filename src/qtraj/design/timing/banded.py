"""Symmetric positive definite systems with three diagonals beside the main one, by Cholesky's factorisation."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Band = Float[Array, "4 n"]
"""Row d holds the entries (i, i − d) at place i."""


def factor(band: Band) -> Band:
    """The rows of the lower triangular factor L, A = LLᵀ: row d holds L(i, i − d), and row 0 holds 1/L(i, i)."""
    zero, one = jnp.zeros_like(band[0, 0]), jnp.ones_like(band[0, 0])
    first: Any = ((one,), (zero, one), (zero, zero, one))  # rows i − 3, i − 2 and i − 1, from column i − 3 on

    def step(rows: Any, a: Any) -> tuple[Any, Any]:
        (d3,), (l23, d2), (l13, l12, d1) = rows
        l3 = a[3] * d3
        l2 = (a[2] - l3 * l23) * d2
        l1 = (a[1] - l3 * l13 - l2 * l12) * d1
        inverse = jax.lax.rsqrt(a[0] - l3 * l3 - l2 * l2 - l1 * l1)
        return ((d2,), (l12, d1), (l2, l1, inverse)), (inverse, l1, l2, l3)

    _, rows = jax.lax.scan(step, first, tuple(band))
    return jnp.stack(rows)


def solve(factored: Band, right: Float[Array, " n"]) -> Float[Array, " n"]:
    """x of LLᵀx = right."""
    zero = jnp.zeros_like(right[0])

    def forward(y: Any, row: Any) -> tuple[Any, Any]:
        inverse, l1, l2, l3, b = row
        now = (b - l1 * y[0] - l2 * y[1] - l3 * y[2]) * inverse
        return (now, y[0], y[1]), now

    def backward(x: Any, row: Any) -> tuple[Any, Any]:
        inverse, l1, l2, l3, y = row
        now = (y - l1 * x[0] - l2 * x[1] - l3 * x[2]) * inverse
        return (now, x[0], x[1]), now

    inverse, l1, l2, l3 = factored
    _, y = jax.lax.scan(forward, (zero,) * 3, (inverse, l1, l2, l3, right))
    columns = [jnp.pad(row[k:], (0, k)) for k, row in ((1, l1), (2, l2), (3, l3))]  # L(i + k, i)
    _, x = jax.lax.scan(backward, (zero,) * 3, (inverse, *columns, y), reverse=True)
    return x
