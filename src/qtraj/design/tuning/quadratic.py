"""Small convex quadratic programs by Mehrotra's interior point: a fixed number of steps, made for many lanes at once.

The factorisation is written out entry by entry: for matrices this small it compiles to plain arithmetic over the lanes,
several times faster than a call to LAPACK for each of them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Flag, Scalar, ScalarLike

TO_THE_BORDER = 0.995  # of the way to where a slack or a multiplier would vanish
LEAST_GAP = 1e-17  # of complementarity: below it only rounding moves the iterate
FIRST = 0.1  # slack and multiplier at the start, in problems scaled to numbers near one

Vector = Float[Array, " n"]
Matrix = Float[Array, "n n"]


class Factor(NamedTuple):
    """The Cholesky factor of a symmetric matrix, its pivots, and the inverse of its diagonal."""

    lower: list[list[Scalar]]
    inverse: list[Scalar]
    pivots: Vector


def factor(matrix: Matrix) -> Factor:
    """Cholesky's factorisation; a pivot of a matrix that is not positive definite is not positive."""
    n = matrix.shape[0]
    lower: list[list[Scalar]] = [[] for _ in range(n)]
    inverse, pivots = [], []
    for j in range(n):
        pivot = matrix[j, j] - _dot(lower[j], lower[j])
        pivots.append(pivot)
        inverse.append(jax.lax.rsqrt(jnp.maximum(pivot, jnp.finfo(pivot.dtype).tiny)))
        for i in range(j + 1, n):
            lower[i].append((matrix[i, j] - _dot(lower[i], lower[j])) * inverse[j])
    return Factor(lower, inverse, jnp.stack(pivots))


def substitute(of: Factor, b: Vector) -> Vector:
    """The solution x of A x = b from the factor of A."""
    lower, inverse, _ = of
    n = len(inverse)
    y: list[Scalar] = []
    for i in range(n):
        y.append((b[i] - _dot(lower[i], y)) * inverse[i])
    x: list[Scalar] = []  # from the last to the first
    for i in reversed(range(n)):
        column = [lower[k][i] for k in reversed(range(i + 1, n))]
        x.append((y[i] - _dot(column, x)) * inverse[i])
    return jnp.stack(x[::-1])


def _dot(a: list[Scalar], b: list[Scalar]) -> ScalarLike:
    return sum((p * q for p, q in zip(a, b, strict=False)), 0.0)


class Program(NamedTuple):
    """min ½xᵀHx + cᵀx subject to rows·x ≤ bounds and low ≤ x ≤ high, with H positive definite on what is free."""

    hessian: Matrix
    slope: Vector
    rows: Float[Array, "m n"]
    bounds: Float[Array, " m"]
    low: Vector
    high: Vector

    def products(self, x: Vector) -> Float[Array, " k"]:
        """What is bounded, at `x`: the rows, x, and −x."""
        return jnp.concatenate([self.rows @ x, x, -x])

    def combination(self, y: Float[Array, " k"]) -> Vector:
        """The transpose of `products`."""
        m, n = self.rows.shape
        return y[:m] @ self.rows + y[m : m + n] - y[m + n :]

    def stiffened(self, weights: Float[Array, " k"]) -> Matrix:
        """H and the squares of everything that is bounded, times `weights`."""
        m, n = self.rows.shape
        of_box = weights[m : m + n] + weights[m + n :]
        return self.hessian + (self.rows.T * weights[None, :m]) @ self.rows + jnp.diag(of_box)

    @property
    def room(self) -> Float[Array, " k"]:
        """The bounds on `products`."""
        return jnp.concatenate([self.bounds, self.high, -self.low])


class _Iterate(NamedTuple):
    x: Vector
    slack: Float[Array, " k"]
    multiplier: Float[Array, " k"]


def minimise(program: Program, steps: int) -> tuple[Vector, Float[Array, " m"]]:
    """The solution x, and the multipliers of the rows."""
    slack = jnp.maximum(program.room, FIRST)
    start = _Iterate(jnp.zeros_like(program.slope), slack, jnp.full_like(slack, FIRST))
    end = jax.lax.fori_loop(0, steps, lambda _, at: _advance(program, at), start)
    return end.x, end.multiplier[: program.bounds.shape[0]]


def _advance(program: Program, at: _Iterate) -> _Iterate:
    x, slack, multiplier = at
    count = slack.shape[0]
    inverse = 1 / slack
    dual = program.hessian @ x + program.slope + program.combination(multiplier)
    primal = program.products(x) + slack - program.room
    gap = slack @ multiplier / count
    of = factor(program.stiffened(multiplier * inverse))

    def direction(complementarity: Float[Array, " k"]) -> _Iterate:
        dx = substitute(of, -dual - program.combination((multiplier * primal - complementarity) * inverse))
        ds = -primal - program.products(dx)
        return _Iterate(dx, ds, (-complementarity - multiplier * ds) * inverse)

    first = direction(slack * multiplier)
    reached = (slack + _reach(slack, first.slack) * first.slack) @ (
        multiplier + _reach(multiplier, first.multiplier) * first.multiplier
    )
    centring = (reached / count / gap) ** 3 * gap
    second = direction(slack * multiplier + first.slack * first.multiplier - centring)
    primal_step = _reach(slack, second.slack, TO_THE_BORDER)
    dual_step = _reach(multiplier, second.multiplier, TO_THE_BORDER)
    moved = _Iterate(
        x + primal_step * second.x, slack + primal_step * second.slack, multiplier + dual_step * second.multiplier
    )
    sound = jnp.isfinite(jnp.sum(second.x) + jnp.sum(second.multiplier)) & (gap > LEAST_GAP)
    return jax.tree.map(lambda new, old: jnp.where(sound, new, old), moved, at)


def _reach(v: Float[Array, " k"], change: Float[Array, " k"], part: float = 1.0) -> Scalar:
    """The largest step up to 1 that keeps v + step·change positive, or that `part` of it."""
    shrinks: Flag = change < 0
    return jnp.minimum(1.0, part * jnp.min(jnp.where(shrinks, -v / jnp.where(shrinks, change, -1.0), jnp.inf)))
