"""Symmetric positive definite band systems (three subdiagonals), by the Cholesky factorisation."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Band = Float[Array, "4 n"]
"""Row d contains the entry (i, i − d) of the matrix at index i."""


def factor(band: Band) -> Band:
    """The lower triangular factor L of A = LLᵀ: row d contains L(i, i − d), but row 0 contains 1/L(i, i)."""
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
    """The solution x of LLᵀx = right."""
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
