"""Solve the band systems of `banded` for a batch of matrices, one row after another.

Each step of a scan computes one row of all matrices of the batch. For many small matrices this is several times faster
than `banded`, because the inverse factors of the blocks in `banded` need more arithmetic. The scans use one array for
each diagonal, so that under `jax.vmap` the batch is the last axis in every step.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

UNROLLED = 4
"""Number of rows in one iteration of a compiled loop."""


class Factored(NamedTuple):
    """The lower Cholesky factor: its entries (i, i − 3), (i, i − 2) and (i, i − 1), and inverses of its diagonal."""

    third: Float[Array, " n"]
    second: Float[Array, " n"]
    first: Float[Array, " n"]
    inverse: Float[Array, " n"]


def factor(band: Float[Array, "4 n"]) -> Factored:
    """Factorise a matrix; column i of `band` contains the entries (i, i − 3) to (i, i) of the matrix."""

    def step(last: Any, row: tuple[Array, ...]) -> tuple[Any, Factored]:
        """Compute a row of the factor from the three rows before it."""
        before, middle, after = last
        third = row[0] * before.inverse
        second = (row[1] - third * middle.first) * middle.inverse
        first = (row[2] - third * after.second - second * after.first) * after.inverse
        own = Factored(third, second, first, jax.lax.rsqrt(row[3] - third**2 - second**2 - first**2))
        return (middle, after, own), own

    zero, one = jnp.zeros_like(band[0, 0]), jnp.ones_like(band[0, 0])
    unit = Factored(zero, zero, zero, one)
    return jax.lax.scan(step, (unit, unit, unit), tuple(band), unroll=UNROLLED)[1]


def solve(f: Factored, right: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the solution of the linear system with the factored matrix."""

    def forward(last: tuple[Array, ...], given: tuple[Factored, Array]) -> tuple[Any, Array]:
        (before, middle, after), (row, b) = last, given
        y = (b - row.third * before - row.second * middle - row.first * after) * row.inverse
        return (middle, after, y), y

    def backward(known: tuple[Array, ...], given: tuple[Factored, Array]) -> tuple[Any, Array]:
        """Solve for unknown i; `known` contains the contributions of later unknowns to rows i, i − 1 and i − 2."""
        row, y = given
        x = (y - known[0]) * row.inverse
        return (known[1] + row.first * x, known[2] + row.second * x, row.third * x), x

    none = (jnp.zeros_like(right[0]),) * 3
    _, y = jax.lax.scan(forward, none, (f, right), unroll=UNROLLED)
    return jax.lax.scan(backward, none, (f, y), reverse=True, unroll=UNROLLED)[1]
