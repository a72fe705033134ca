"""Small convex quadratic programs by Mehrotra's interior point: a fixed number of steps, made for many lanes at once.

The factorisation is written out entry by entry: for matrices this small it compiles to plain arithmetic over the lanes,
several times faster than a call to LAPACK for each of them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.foundation.types import Flag, Scalar, ScalarLike

TOLERANCE = 1e-12  # to which bounds are kept, in problems scaled to numbers near one
DEPENDENT = 1e-13  # a bound whose normal the active ones leave less of than this depends on them

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


class _Active(NamedTuple):
    """The solution under some of the bounds, held as equalities, each in a slot of its own."""

    x: Vector
    inverse: Matrix  # of the Hessian, reduced to where the active bounds leave x free
    pulls: Matrix  # how the multiplier of each slot answers to a force
    multiplier: Vector  # of each slot
    bound: Int[Array, " n"]  # in each slot
    used: Bool[Array, " n"]
    entering: Int[Array, ""]  # the bound that is being made active, or −1
    pull: Scalar  # its multiplier so far
    done: Flag


def minimise(program: Program, most_steps: int) -> tuple[Vector, Float[Array, " m"]]:
    """The solution x, and the multipliers of the rows."""
    n, m = program.slope.shape[0], program.bounds.shape[0]
    whole = inverse(program.hessian)
    start = _Active(
        x=-whole @ program.slope,
        inverse=whole,
        pulls=jnp.zeros_like(whole),
        multiplier=jnp.zeros_like(program.slope),
        bound=jnp.zeros(n, int),
        used=jnp.zeros(n, bool),
        entering=jnp.asarray(-1),
        pull=jnp.zeros_like(program.slope[0]),
        done=jnp.asarray(False),
    )
    unit = jnp.eye(n, dtype=whole.dtype)
    bounded = jnp.concatenate([program.rows, unit, -unit])
    room = jnp.concatenate([program.bounds, program.high, -program.low])
    stiffness = jnp.einsum("ki,ij,kj->k", bounded, whole, bounded)

    def step(state: tuple[_Active, Array]) -> tuple[_Active, Array]:
        at, count = state
        return _advance(program, bounded, room, stiffness, at), count + 1

    end, _ = jax.lax.while_loop(lambda s: ~s[0].done & (s[1] < most_steps), step, (start, jnp.asarray(0)))
    of_rows = (end.bound[None] == jnp.arange(m)[:, None]) & end.used[None]
    return end.x, jnp.sum(jnp.where(of_rows, end.multiplier[None], 0.0), axis=1)


def _advance(program: Program, bounded: Matrix, room: Vector, compliance: Vector, at: _Active) -> _Active:
    """One bound made active, or one let go that stands in its way."""
    left = room - bounded @ at.x
    fresh = at.entering < 0
    p = jnp.where(fresh, jnp.argmin(left), at.entering)
    done = fresh & (left[p] >= -TOLERANCE * (1 + jnp.abs(room[p])))
    a = bounded[p]
    z, r = at.inverse @ a, at.pulls @ a
    give = a @ z
    free = give > DEPENDENT * compliance[p]
    give = jnp.where(free, give, 1.0)
    full = jnp.where(free, jnp.maximum(-left[p], 0.0) / give, jnp.inf)
    shrinks = at.used & (r > 0)
    ratios = jnp.where(shrinks, at.multiplier / jnp.where(shrinks, r, 1.0), jnp.inf)
    tau = jnp.minimum(full, jnp.min(ratios))
    tau = jnp.where(jnp.isfinite(tau), tau, 0.0)
    adds = full <= jnp.min(ratios)
    slots = jnp.arange(at.used.shape[0])
    slot = jnp.where(adds, jnp.argmin(at.used), jnp.argmin(ratios))
    here = slots == slot
    u = at.pulls[slot]
    h = program.hessian @ u
    q = u @ h
    q = jnp.where(q > 0, q, 1.0)
    direction = jnp.where(adds, z, u)
    scale = jnp.where(adds, -1 / give, 1 / q)
    along = jnp.where(adds, r / give, at.pulls @ h / q)
    pulls = at.pulls - along[:, None] * direction[None]
    pulls = jnp.where(here[:, None], jnp.where(adds, z / give, 0.0)[None], pulls)
    pull = at.pull + tau
    multiplier = jnp.maximum(at.multiplier - tau * r, 0.0)
    moved = _Active(
        x=at.x - jnp.where(free, tau, 0.0) * z,
        inverse=at.inverse + scale * direction[:, None] * direction[None],
        pulls=pulls,
        multiplier=jnp.where(here, jnp.where(adds, pull, 0.0), multiplier),
        bound=jnp.where(here, p, at.bound),
        used=jnp.where(here, adds, at.used),
        entering=jnp.where(adds, -1, p),
        pull=jnp.where(adds, 0.0, pull),
        done=done,
    )
    return jax.tree.map(lambda new, old: jnp.where(done, old, new), moved._replace(done=jnp.asarray(False)), at)._replace(done=done)


def inverse(matrix: Matrix) -> Matrix:
    """The inverse of a positive definite matrix."""
    of = factor(matrix)
    return jax.vmap(lambda column: substitute(of, column), out_axes=1)(jnp.eye(matrix.shape[0], dtype=matrix.dtype))
