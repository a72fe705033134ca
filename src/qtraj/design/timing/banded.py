"""Solve symmetric positive definite band systems with three subdiagonals by a block Cholesky factorisation.

Each block of rows ends with three unknowns that separate it from the next block. The other unknowns of all blocks are
eliminated at the same time. This leaves a small system for the separating unknowns. LAPACK's dense factorisation is
the fastest method for a small system; a larger one is factorised row by row. In `left`, `right` and `inverse_factor`,
the last axis indexes the blocks.
"""

import functools
import operator
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

BELOW = 3
"""Number of subdiagonals."""

SIZES = ((150, 16), (600, 24), (1100, 32), (10**9, 64))
"""Pairs (n, rows): a system with at most n unknowns is divided into blocks of this number of rows."""

DENSE = 110
"""The largest number of separating unknowns for which LAPACK was measured to be faster than our own factorisation. At
about 129 unknowns LAPACK's run time jumps, most likely because LAPACK starts to use several threads."""


def total(terms: Iterable[Any]) -> Any:
    """Return the sum of arrays; unlike the sum of a stacked array over a short axis, this compiles to one loop."""
    return functools.reduce(operator.add, terms)


class Factored(NamedTuple):
    """A factored matrix.

    `inner` contains the inverse Cholesky factors of the blocks. `left` and `right` are the entries of the Cholesky
    factor that couple each block to the separating unknowns before it and at its end. `separators` is the Cholesky
    factor of the system for the separating unknowns.
    """

    inner: Float[Array, "blocks m m"]
    left: Float[Array, "m 3 blocks"]
    right: Float[Array, "m 3 blocks"]
    separators: Float[Array, "k k"]  # the inverse of the factor if k > DENSE


def factor(band: Float[Array, "4 n"]) -> Factored:
    """Factorise a matrix; column i of `band` contains the entries (i, i − 3) to (i, i) of the matrix."""
    n = band.shape[1]
    size = next(rows for largest, rows in SIZES if n <= largest)
    more = -n % size
    unit = jnp.concatenate([jnp.zeros((BELOW, more), band.dtype), jnp.ones((1, more), band.dtype)])
    rows = jnp.concatenate([band, unit], axis=1).reshape(BELOW + 1, -1, size).transpose(2, 0, 1)
    before = skewed(rows[:BELOW, :BELOW])[:, :BELOW]  # couples the first three rows with the separator before the block
    inner = inverse_factor(rows[:-BELOW].at[:BELOW].multiply(_own(BELOW, band.dtype)))
    # The last three rows of a block have entries in three inner columns and, up to the diagonal, in their own columns.
    last = skewed(rows[-BELOW:])
    across, own = last[:, :BELOW], last[:, BELOW:]
    left = total(inner[:, k, None] * before[k][None] for k in range(BELOW))
    right = total(inner[:, k - BELOW, None] * across[None, :, k] for k in range(BELOW))
    both = jnp.concatenate([left, right], axis=1).transpose(2, 0, 1)
    taken = both.transpose(0, 2, 1) @ both
    after = jnp.pad(taken[1:, :BELOW, :BELOW], [(0, 1), (0, 0), (0, 0)])
    diagonal = own.transpose(2, 0, 1) - taken[:, BELOW:, BELOW:] - after
    separators = _factored_blocks(diagonal, -taken[:, BELOW:, :BELOW])
    return Factored(inner.transpose(2, 0, 1), left, right, separators)


def solve(f: Factored, right: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the solution of the linear system with the factored matrix."""
    blocks, rows = f.inner.shape[:2]
    b = jnp.pad(right, (0, blocks * (rows + BELOW) - right.size)).reshape(blocks, -1)
    y = jnp.einsum("bij,bj->bi", f.inner, b[:, :rows]).T
    before, own = (jnp.sum(x * y[:, None], axis=0) for x in (f.left, f.right))
    reduced = b[:, rows:].T - own - jnp.pad(before[:, 1:], [(0, 0), (0, 1)])
    x = _of_separators(f.separators, reduced.T.reshape(-1)).reshape(blocks, BELOW).T
    previous = jnp.pad(x[:, :-1], [(0, 0), (1, 0)])
    y = y - total(f.left[:, k] * previous[None, k] + f.right[:, k] * x[None, k] for k in range(BELOW))
    inner = jnp.einsum("bij,bi->bj", f.inner, y.T)
    return jnp.concatenate([inner, x.T], axis=1).reshape(-1)[: right.size]


def _factored_blocks(own: Float[Array, "blocks 3 3"], before: Float[Array, "blocks 3 3"]) -> Float[Array, "k k"]:
    """Factorise the matrix with the blocks `own` on the diagonal and `before` to the left of them."""
    blocks = own.shape[0]
    if BELOW * blocks > DENSE:
        rows = jnp.concatenate([before, own], axis=2).transpose(1, 2, 0)
        rows = skewed(rows[::-1])[::-1, : rows.shape[1]]  # each row ends with its diagonal entry
        return inverse_factor(jnp.moveaxis(rows, -1, 0).reshape(-1, 2 * BELOW, 1))[..., 0]
    on, under = (jnp.eye(blocks, k=k, dtype=own.dtype)[:, None, :, None] for k in (0, -1))
    lower = on * own[:, :, None] + under * before[:, :, None]
    return jax.lax.linalg.cholesky(lower.reshape(BELOW * blocks, BELOW * blocks), symmetrize_input=False)


def _of_separators(factored: Float[Array, "k k"], right: Float[Array, " k"]) -> Float[Array, " k"]:
    """Return the values of the separating unknowns."""
    if right.size > DENSE:
        return jnp.sum(factored * jnp.sum(factored * right[None], axis=1)[:, None], axis=0)
    triangular = functools.partial(jax.lax.linalg.triangular_solve, factored, left_side=True, lower=True)
    return triangular(triangular(right[:, None]), transpose_a=True)[:, 0]


def inverse_factor(rows: Float[Array, "m w+1 blocks"]) -> Float[Array, "m m blocks"]:
    """Return the inverses of the lower Cholesky factors of band matrices with w subdiagonals.

    `rows[i]` contains the entries (i, i − w) to (i, i); entries before the first column must be zero.
    """
    m, width, dtype = rows.shape[0], rows.shape[1] - 1, rows.dtype
    blocks = rows.shape[2]
    unit = jnp.broadcast_to(jnp.eye(width, dtype=dtype)[:, :, None], (width, width, blocks))
    none = jnp.zeros((width, m, blocks), dtype)

    def step(last: Any, given: Any) -> tuple[Any, Array]:
        """Compute a row of the inverse Cholesky factor from the w previous rows, `whole`.

        `corner` contains their entries in the w columns before the diagonal of the new row.
        """
        whole, corner = last
        row, at = given
        factor = jnp.sum(corner * row[None, :-1], axis=1)
        inverse = jax.lax.rsqrt(row[-1] - jnp.sum(factor**2, axis=0))[None]
        new = (at[:, None] - jnp.sum(factor[:, None] * whole, axis=0)) * inverse
        below = -jnp.sum(factor[:, None] * corner, axis=0) * inverse
        corner = jnp.concatenate([corner[1:], below[None]])
        column = jnp.zeros_like(below).at[-1].set(inverse[0])
        corner = jnp.concatenate([corner[:, 1:], column[:, None]], axis=1)
        return (jnp.concatenate([whole[1:], new[None]]), corner), new

    _, found = jax.lax.scan(step, (none, unit), (rows, jnp.eye(m, dtype=dtype)))
    return found


def _own(count: int, dtype: Any) -> Array:
    """Return a mask of the first `count` rows: 1 for entries in existing columns, 0 before the first column."""
    return jnp.asarray([[i + e >= count for e in range(count + 1)] for i in range(count)], dtype)[:, :, None]


def skewed(x: Float[Array, "rows n ..."], step: int = 1) -> Float[Array, "rows m ..."]:
    """Return the array with row k shifted to the right by k·`step` columns, and zeros elsewhere."""
    rows, n = x.shape[:2]
    width = n + step * (rows - 1)
    padded = jnp.pad(x, [(0, 0), (0, width + step - n), *[(0, 0)] * (x.ndim - 2)])
    return padded.reshape(-1, *x.shape[2:])[: rows * width].reshape(rows, width, *x.shape[2:])
