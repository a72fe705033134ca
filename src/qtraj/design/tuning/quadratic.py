"""Small elastic quadratic programs by the dual active-set method of Goldfarb and Idnani.

It starts from the solution with the excess t held at its least and nothing else bounded, and makes the farthest broken
bound active, one after the other, letting go those whose multiplier would turn negative on the way. So it ends after a
few steps at the solution, to rounding, however large the penalty and however small the box; and it says so. How far a
bound is broken is measured by the Hessian: fewer turn out to be needless than by its own numbers.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from qtraj.foundation.least import least
from qtraj.foundation.types import Flag, Scalar

MOST_STEPS = 60
TOLERANCE = 1e-12  # to which bounds are kept, in programs scaled to numbers near one
UNBALANCED = 1e-7  # of the sizes of slope and penalty: what is worse is no solution
DEPENDENT = 1e-13  # a bound that gives way less than this, for the softest Hessian, depends on the active ones

Index = Int[Array, ""]
Vector = Float[Array, " n"]
Matrix = Float[Array, "n n"]


class Program(NamedTuple):
    """min ½dᵀHd + cᵀd + ½εt² + νt subject to rows·d − t ≤ bounds, low ≤ d ≤ high and t ≥ least.

    H is positive definite; ε > 0 keeps the program strictly convex in t as well, and ν + ε·least must be positive.
    """

    hessian: Float[Array, "n n"]
    slope: Float[Array, " n"]
    rows: Float[Array, "m n"]
    bounds: Float[Array, " m"]
    low: Float[Array, " n"]
    high: Float[Array, " n"]
    penalty: Scalar  # ν
    stiffness: Scalar  # ε
    least: Scalar

    @property
    def room(self) -> Float[Array, " k"]:
        """All bounds: of the rows, above, below, and the least excess."""
        return jnp.concatenate([self.bounds, self.high, -self.low, -self.least[None]])

    def reached(self, x: Float[Array, " q"]) -> Float[Array, " k"]:
        """What they bound, at x = (d, t)."""
        d, t = x[:-1], x[-1]
        return jnp.concatenate([self.rows @ d - t, d, -d, -t[None]])

    def normal(self, p: Index) -> Float[Array, " q"]:
        """The gradient of what bound `p` bounds."""
        m, n = self.rows.shape
        axis = jnp.arange(n)
        of_box = jnp.where(p == m + axis, 1.0, jnp.where(p == m + n + axis, -1.0, 0.0)).astype(self.slope.dtype)
        of_d = jnp.where(p < m, self.rows[jnp.minimum(p, m - 1)], of_box)
        of_t = jnp.where((p < m) | (p == m + 2 * n), -1.0, 0.0).astype(of_d.dtype)
        return jnp.append(of_d, of_t)


class _Active(NamedTuple):
    """The solution x = (d, t) under some of the bounds, held as equalities, each in a slot of its own."""

    x: Float[Array, " q"]
    inverse: Float[Array, "q q"]  # of the Hessian, reduced to where the active bounds leave x free
    pulls: Float[Array, "q q"]  # how the multiplier of each slot answers to a force
    multiplier: Float[Array, " q"]  # of each slot
    bound: Int[Array, " q"]  # in each slot
    used: Bool[Array, " q"]
    entering: Index  # the bound that is being made active, or −1
    pull: Scalar  # its multiplier so far
    done: Flag
    stuck: Flag  # no bound can be made active, and none let go: the numbers are too far apart


class _Way(NamedTuple):
    """Where a bound's entering leads: x goes along −direction, the multipliers along −force, per unit of its own."""

    bound: Index
    direction: Float[Array, " q"]
    force: Float[Array, " q"]
    give: Scalar  # how fast the bound is met


class _Metric(NamedTuple):
    """What the Hessian's inverse says of sizes."""

    softness: Scalar  # its largest entry
    shortening: Float[Array, " k"]  # one over the lengths of the bounds' gradients in d


class Solution(NamedTuple):
    """The solution d and t, the multipliers of the rows, whether the program was solved, and in how many steps."""

    d: Vector
    t: Scalar
    multipliers: Float[Array, " m"]
    solved: Flag
    steps: Int[Array, ""]


def minimise(program: Program) -> Solution:
    """The solution of a program."""
    first = _start(program)
    metric = _metric(program, first.inverse[:-1, :-1])

    def step(state: tuple[_Active, Index]) -> tuple[_Active, Index]:
        at, count = state
        after = _advance(program, metric, at)
        over = after.done | after.stuck
        kept = jax.tree.map(lambda new, old: jnp.where(over, old, new), after, at)
        return kept._replace(done=over, stuck=after.stuck), count + 1

    start = (first, jnp.asarray(0))
    end, steps = jax.lax.while_loop(lambda s: ~s[0].done & (s[1] < MOST_STEPS), step, start)
    of_rows = (end.bound[None] == jnp.arange(program.bounds.shape[0])[:, None]) & end.used[None]
    multipliers = of_rows.astype(end.x.dtype) @ end.multiplier
    return Solution(end.x[:-1], end.x[-1], multipliers, end.done & ~end.stuck & _balanced(program, end), steps)


def _metric(program: Program, inverse: Matrix) -> _Metric:
    diagonal = jnp.diagonal(inverse)
    softness = jnp.maximum(jnp.max(diagonal), 1 / program.stiffness)
    columns = [*program.rows.T]
    of_rows = _dot([_dot([*line], columns) for line in inverse], columns)  # entry by entry, as in `_factor`
    squares = jnp.concatenate([of_rows, diagonal, diagonal])
    return _Metric(softness, jnp.append(jax.lax.rsqrt(jnp.maximum(squares, jnp.finfo(squares.dtype).tiny)), 1.0))


def _balanced(program: Program, at: _Active) -> Flag:
    """Whether the active bounds are met and their multipliers hold the slope: rounding may have spoilt the updates."""
    held = jnp.where(at.used, at.multiplier, 0.0) @ jax.vmap(program.normal)(at.bound)
    slope = jnp.append(program.hessian @ at.x[:-1] + program.slope, program.stiffness * at.x[-1] + program.penalty)
    left = jnp.where(at.used, (program.room - program.reached(at.x))[at.bound], 0.0)
    size = 1 + program.penalty + jnp.max(jnp.abs(program.slope))
    return jnp.maximum(jnp.max(jnp.abs(slope + held)), jnp.max(jnp.abs(left))) < UNBALANCED * size  # false for NaN


def _start(program: Program) -> _Active:
    """Nothing active but the least excess, in the last slot."""
    m, n = program.rows.shape
    whole = _inverse(program.hessian)
    last = jnp.arange(n + 1) == n
    return _Active(
        x=jnp.append(-whole @ program.slope, program.least),
        inverse=jnp.pad(whole, (0, 1)),
        pulls=jnp.zeros((n + 1, n + 1), whole.dtype).at[n, n].set(-1.0),
        multiplier=jnp.where(last, program.penalty + program.stiffness * program.least, 0.0),
        bound=jnp.full(n + 1, m + 2 * n),
        used=last,
        entering=jnp.asarray(-1),
        pull=jnp.zeros_like(program.penalty),
        done=jnp.asarray(False),
        stuck=jnp.asarray(False),
    )


def _advance(program: Program, metric: _Metric, at: _Active) -> _Active:
    """One bound made active, or one let go that stands in its way; `done` where none is broken."""
    room = program.room
    left = room - program.reached(at.x)
    broken = left < -TOLERANCE * (1 + jnp.abs(room))
    most, farthest = least(jnp.where(broken, left * metric.shortening, 0.0))
    p = jnp.where(at.entering < 0, farthest, at.entering)
    done = (at.entering < 0) & (most >= 0)
    way = _way(program, metric.softness, at, p)
    # As far as the bound is met, or until the multiplier of another one vanishes.
    whole = jnp.where(way.give > 0, jnp.maximum(-left[p], 0.0) / jnp.where(way.give > 0, way.give, 1.0), jnp.inf)
    shrinks = at.used & (way.force > 0)
    ratios = jnp.where(shrinks, at.multiplier / jnp.where(shrinks, way.force, 1.0), jnp.inf)
    nearest, hindering = least(ratios)
    far = jnp.minimum(whole, nearest)
    far = jnp.where(jnp.isfinite(far), far, 0.0)
    moved = at._replace(
        x=at.x - jnp.where(way.give > 0, far, 0.0) * way.direction,
        multiplier=jnp.maximum(at.multiplier - far * way.force, 0.0),
        pull=at.pull + far,
        done=done,
        stuck=~done & ~jnp.isfinite(jnp.minimum(whole, nearest)),
    )
    adds = whole <= nearest
    slot = jnp.where(adds, jnp.argmin(at.used), hindering)
    return _changed(program, moved, way, adds, slot)


def _way(program: Program, softness: Scalar, at: _Active, p: Index) -> _Way:
    a = program.normal(p)
    direction = at.inverse @ a
    give = a @ direction
    free = (give > DEPENDENT * softness * (a @ a)) & ~jnp.all(at.used)
    return _Way(p, direction, at.pulls @ a, jnp.where(free, give, 0.0))


def _changed(program: Program, at: _Active, way: _Way, adds: Flag, slot: Index) -> _Active:
    """The entering bound taken into a slot, or the one in that slot let go: a change of rank one."""
    here = jnp.arange(at.used.shape[0]) == slot
    u = at.pulls[slot]
    bent = jnp.append(program.hessian @ u[:-1], program.stiffness * u[-1])
    bend = u @ bent
    bend = jnp.where(bend > 0, bend, 1.0)
    give = jnp.where(way.give > 0, way.give, 1.0)
    direction = jnp.where(adds, way.direction, u)
    along = jnp.where(adds, way.force / give, at.pulls @ bent / bend)
    entered = jnp.where(adds, way.direction / give, 0.0)
    return at._replace(
        inverse=at.inverse + jnp.where(adds, -1 / give, 1 / bend) * direction[:, None] * direction[None],
        pulls=jnp.where(here[:, None], entered[None], at.pulls - along[:, None] * direction[None]),
        multiplier=jnp.where(here, jnp.where(adds, at.pull, 0.0), at.multiplier),
        bound=jnp.where(here, way.bound, at.bound),
        used=jnp.where(here, adds, at.used),
        entering=jnp.where(adds, -1, way.bound),
        pull=jnp.where(adds, 0.0, at.pull),
    )


def least_pivot(matrix: Matrix) -> Scalar:
    """The least pivot of Cholesky's factorisation: positive for a positive definite matrix."""
    return jnp.min(jnp.stack(_factor(matrix)[2]))


def _factor(matrix: Matrix) -> tuple[list[list[Scalar]], list[Scalar], list[Scalar]]:
    """Cholesky's factor by rows, the inverse of its diagonal, and the pivots.

    Entry by entry: for matrices this small that compiles to plain arithmetic over the lanes, several times faster than
    a call to LAPACK for each of them.
    """
    n = matrix.shape[0]
    lower: list[list[Scalar]] = [[] for _ in range(n)]
    inverse, pivots = [], []
    for j in range(n):
        pivot = matrix[j, j] - _dot(lower[j], lower[j])
        pivots.append(pivot)
        inverse.append(jax.lax.rsqrt(jnp.maximum(pivot, jnp.finfo(pivot.dtype).tiny)))
        for i in range(j + 1, n):
            lower[i].append((matrix[i, j] - _dot(lower[i], lower[j])) * inverse[j])
    return lower, inverse, pivots


def _inverse(matrix: Matrix) -> Matrix:
    """The inverse KᵀK of a positive definite matrix, from that K of its Cholesky factor."""
    lower, diagonal, _ = _factor(matrix)
    n = len(diagonal)
    columns: list[list[Scalar]] = []  # of K, from the diagonal down
    for j in range(n):
        column = [diagonal[j]]
        for i in range(j + 1, n):
            column.append(-diagonal[i] * _dot(lower[i][j:], column))
        columns.append(column)
    above = [[_dot(columns[i][j - i :], columns[j]) for j in range(i, n)] for i in range(n)]
    return jnp.stack([jnp.stack([jnp.asarray(above[min(i, j)][abs(i - j)]) for j in range(n)]) for i in range(n)])


def _dot(a: Sequence[ArrayLike], b: Sequence[Array]) -> ArrayLike:
    return sum((p * q for p, q in zip(a, b, strict=False)), 0.0)
