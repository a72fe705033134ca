"""Solve symmetric block-tridiagonal systems by block elimination, in time proportional to the number of blocks.

A cyclic system, in which the last block is coupled to the first one, is solved as a block-tridiagonal system with a
border, by the Schur complement of the border.

Each block is eliminated by Gauss–Jordan steps without pivoting, which are stable for positive definite matrices. All
pivots are positive if and only if the matrix is positive definite. The blocks are small, so products of whole arrays
are faster than calls of a linear algebra library.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Border(NamedTuple):
    """The rows and columns of block 0 of a cyclic system.

    `corner` is the diagonal block 0, and `side[i]` couples block i (rows) to block 0 (columns).
    """

    corner: Float[Array, "b b"]
    side: Float[Array, "n b b"]


class Chain(NamedTuple):
    """A symmetric block-tridiagonal matrix, or the matrix of a cyclic system.

    `diagonal` contains the diagonal blocks, and `lower[i]` couples block i + 1 (rows) to block i (columns). The
    `border` of a cyclic system contains all rows and columns of block 0; then `diagonal[0]` is the identity matrix, and
    `lower[0]` and `border.side[0]` are zero.
    """

    diagonal: Float[Array, "n b b"]
    lower: Float[Array, "n-1 b b"]
    border: Border | None = None


def shifted(chain: Chain, shift: Float[Array, "n b"]) -> Chain:
    """Return the matrix with `shift` added to its diagonal."""
    own = shift[:, :, None] * jnp.eye(shift.shape[1], dtype=shift.dtype)[None]
    if chain.border is None:
        return chain._replace(diagonal=chain.diagonal + own)
    border = chain.border._replace(corner=chain.border.corner + own[0])
    return Chain(chain.diagonal + own.at[0].set(0.0), chain.lower, border)


def solve(chain: Chain, right: Float[Array, "n b"]) -> tuple[Float[Array, "n b"], Bool[Array, ""]]:
    """Solve the system; also return whether the matrix is positive definite. If not, the solution is invalid."""
    if chain.border is None:
        found, positive = _eliminated(chain, right[:, :, None])
        return found[:, :, 0], positive
    side, size = chain.border.side, right.shape[1]
    found, positive = _eliminated(chain, jnp.concatenate([right.at[0].set(0.0)[:, :, None], side], axis=2))
    reduced = jnp.einsum("nij,nik->jk", side, found)
    schur = chain.border.corner - reduced[:, 1:]
    one = Chain(schur[None], jnp.zeros((0, size, size), right.dtype))
    first, definite = _eliminated(one, (right[0] - reduced[:, 0])[None, :, None])
    first = first[0, :, 0]
    rest = found[:, :, 0] - jnp.einsum("nij,j->ni", found[:, :, 1:], first)
    return rest.at[0].set(first), positive & definite


def _eliminated(
    chain: Chain, right: Float[Array, "n b columns"]
) -> tuple[Float[Array, "n b columns"], Bool[Array, ""]]:
    """Solve the system without its border for several right-hand sides."""
    size = right.shape[1]
    below = jnp.concatenate([chain.lower, jnp.zeros_like(chain.diagonal[:1])])
    after = jnp.concatenate([chain.diagonal[1:], jnp.eye(size, dtype=right.dtype)[None]])
    rest = jnp.concatenate([right[1:], jnp.zeros_like(right[:1])])

    def eliminate(carry, row):
        block, value = carry
        down, following, known = row
        table = jnp.concatenate([block, down.T, value], axis=1)
        positive = jnp.asarray(True)
        for k in range(size):
            pivot = table[k, k]
            positive &= pivot > 0
            line = table[k] / pivot
            table = (table - table[:, k : k + 1] * line[None]).at[k].set(line)
        factor, reduced = table[:, size : 2 * size], table[:, 2 * size :]
        block = following - jnp.sum(down[:, :, None] * factor[None], axis=1)
        value = known - _times(down, reduced)
        return (block, value), (factor, reduced, positive)

    def substitute(later, row):
        factor, reduced = row
        found = reduced - _times(factor, later)
        return found, found

    _, (factors, reduced, positive) = jax.lax.scan(eliminate, (chain.diagonal[0], right[0]), (below, after, rest))
    _, found = jax.lax.scan(substitute, jnp.zeros_like(right[0]), (factors, reduced), reverse=True)
    return found, jnp.all(positive)


def _times(matrix: Float[Array, "b b"], columns: Float[Array, "b columns"]) -> Float[Array, "b columns"]:
    return jnp.sum(matrix[:, :, None] * columns[None], axis=1)


def product(chain: Chain, x: Float[Array, "n b"]) -> Float[Array, "n b"]:
    """Return the product of the matrix and a vector."""
    if chain.border is None:
        return _product(chain, x)
    side, first = chain.border.side, x[0]
    found = _product(chain, x) + jnp.einsum("nij,j->ni", side, first)
    return found.at[0].set(chain.border.corner @ first + jnp.einsum("nij,ni->j", side, x))


def _product(chain: Chain, x: Float[Array, "n b"]) -> Float[Array, "n b"]:
    own = jnp.sum(chain.diagonal * x[:, None], axis=2)
    up = jnp.sum(chain.lower * x[:-1, None], axis=2)
    down = jnp.sum(chain.lower * x[1:, :, None], axis=1)
    return own.at[1:].add(up).at[:-1].add(down)
