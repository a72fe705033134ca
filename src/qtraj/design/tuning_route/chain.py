"""Solve symmetric block-tridiagonal systems by block elimination, in time proportional to the number of blocks.

Each block is eliminated by Gauss–Jordan steps without pivoting, which are stable for positive definite matrices. All
pivots are positive if and only if the matrix is positive definite. The blocks are small, so products of whole arrays
are faster than calls of a linear algebra library.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Chain(NamedTuple):
    """The diagonal blocks, and the blocks below them: `lower[i]` couples block i + 1 (rows) to block i (columns)."""

    diagonal: Float[Array, "n b b"]
    lower: Float[Array, "n-1 b b"]


def solve(chain: Chain, right: Float[Array, "n b"]) -> tuple[Float[Array, "n b"], Bool[Array, ""]]:
    """The solution, and whether the matrix is positive definite to rounding; if it is not, the solution is invalid."""
    size = right.shape[1]
    below = jnp.concatenate([chain.lower, jnp.zeros_like(chain.diagonal[:1])])
    after = jnp.concatenate([chain.diagonal[1:], jnp.eye(size, dtype=right.dtype)[None]])
    rest = jnp.concatenate([right[1:], jnp.zeros_like(right[:1])])

    def eliminate(carry, row):
        block, value = carry
        down, following, known = row
        table = jnp.concatenate([block, down.T, value[:, None]], axis=1)
        positive = jnp.asarray(True)
        for k in range(size):
            pivot = table[k, k]
            positive &= pivot > 0
            line = table[k] / pivot
            table = (table - table[:, k : k + 1] * line[None]).at[k].set(line)
        factor, reduced = table[:, size : 2 * size], table[:, 2 * size]
        block = following - jnp.sum(down[:, :, None] * factor[None], axis=1)
        value = known - jnp.sum(down * reduced[None], axis=1)
        return (block, value), (factor, reduced, positive)

    def substitute(later, row):
        factor, reduced = row
        found = reduced - jnp.sum(factor * later[None], axis=1)
        return found, found

    _, (factors, reduced, positive) = jax.lax.scan(eliminate, (chain.diagonal[0], right[0]), (below, after, rest))
    _, found = jax.lax.scan(substitute, jnp.zeros_like(right[0]), (factors, reduced), reverse=True)
    return found, jnp.all(positive)


def product(chain: Chain, x: Float[Array, "n b"]) -> Float[Array, "n b"]:
    """The product of the matrix and a vector."""
    own = jnp.sum(chain.diagonal * x[:, None], axis=2)
    up = jnp.sum(chain.lower * x[:-1, None], axis=2)
    down = jnp.sum(chain.lower * x[1:, :, None], axis=1)
    return own.at[1:].add(up).at[:-1].add(down)
