"""Small elastic quadratic programs by the dual active-set method of Goldfarb and Idnani.

It starts from the solution with the violation t held at its least and no other constraint active, and makes the one
that is violated most active, one after the other, dropping those whose multiplier would turn negative on the way. So it
ends after a few steps at the solution, to rounding, however large the penalty and however small the box; and it says
so. How far a constraint is violated is measured by the Hessian: fewer turn out to be needless than by its own numbers.

The constraints come in slots, of which only the first ones are looked at.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.foundation.least import least
from qtraj.foundation.types import Flag, Scalar

MOST_STEPS = 60
TOLERANCE = 1e-12  # to which constraints are met, in programs scaled to numbers near one
UNBALANCED = 1e-7  # of the sizes of slope and penalty: what is worse is no solution
DEPENDENT = 1e-13  # a constraint that gives way less than this, for the softest Hessian, depends on the active ones

Index = Int[Array, ""]
Vector = Float[Array, " n"]
Matrix = Float[Array, "n n"]


class Program(NamedTuple):
    """min ½dᵀHd + cᵀd + ½εt² + νt subject to rows·d − t ≤ bounds, low ≤ d ≤ high and t ≥ least.

    H is positive definite and comes with its inverse; ε > 0 keeps the program strictly convex in t as well, and
    ν + ε·least must be positive.
    """

    hessian: Matrix
    inverse: Matrix
    slope: Vector
    rows: Float[Array, "slots r n"]
    bounds: Float[Array, "slots r"]
    slots: Index  # those that are looked at
    low: Vector
    high: Vector
    penalty: Scalar  # ν
    stiffness: Scalar  # ε
    least: Scalar

    @property
    def total(self) -> int:
        """The number of rows in all slots."""
        return self.bounds.size

    @property
    def box(self) -> Float[Array, " k"]:
        """The bounds behind the rows: above, below, and the least violation."""
        return jnp.concatenate([self.high, -self.low, -self.least[None]])


class Active(NamedTuple):
    """The active constraints, each in a place of its own.

    `row` numbers them: rows slot after slot, then the bounds above and below, then t ≥ least.
    """

    row: Int[Array, " q"]
    normal: Float[Array, "q q"]  # their gradients in (d, t)
    room: Float[Array, " q"]  # what they bound these by
    multiplier: Float[Array, " q"]
    used: Bool[Array, " q"]


class Solution(NamedTuple):
    """The solution d and t; the active constraints; whether it was solved, and in how many steps."""

    d: Vector
    t: Scalar
    active: Active
    solved: Flag
    steps: Index


class _State(NamedTuple):
    """The solution x = (d, t) under the active constraints, held as equalities."""

    x: Float[Array, " q"]
    inverse: Float[Array, "q q"]  # of the Hessian, reduced to where the active constraints leave x free
    answers: Float[Array, "q q"]  # how the multiplier of each place answers to a force
    active: Active
    entering: Index  # the constraint that is being made active, or −1
    force: Scalar  # its multiplier so far
    done: Flag
    stuck: Flag  # no constraint can be made active, and none dropped: the numbers are too far apart


class _Entering(NamedTuple):
    """A constraint that is made active: x goes along −direction, the multipliers along −force, per unit of its own."""

    row: Index
    normal: Float[Array, " q"]
    room: Scalar
    direction: Float[Array, " q"]
    force: Float[Array, " q"]
    give: Scalar  # how fast the constraint is met


def minimise(program: Program) -> Solution:
    """The solution of a program."""
    weights = _weights(program)

    def step(state: tuple[_State, Index]) -> tuple[_State, Index]:
        at, count = state
        after = _advance(program, weights, at)
        over = after.done | after.stuck
        kept = jax.tree.map(lambda new, old: jnp.where(over, old, new), after, at)
        return kept._replace(done=over, stuck=after.stuck), count + 1

    start = (_start(program), jnp.asarray(0, jnp.int32))
    end, steps = jax.lax.while_loop(lambda s: ~s[0].done & (s[1] < MOST_STEPS), step, start)
    return Solution(end.x[:-1], end.x[-1], end.active, end.done & ~end.stuck & _balanced(program, end), steps)


def inverse(matrix: Matrix) -> tuple[Matrix, Scalar]:
    """The inverse of a positive definite matrix by sweeping its columns, and the least pivot on the way.

    The pivots are those of Gaussian elimination: all of them are positive for a positive definite matrix alone.
    """
    places = jnp.arange(matrix.shape[0], dtype=jnp.int32)

    def sweep(k: Index, now: tuple[Matrix, Scalar]) -> tuple[Matrix, Scalar]:
        matrix, smallest = now
        here = places == k
        pivot = matrix[k, k]
        over = 1 / jnp.where(pivot == 0, 1.0, pivot)
        column, row = matrix[:, k], jnp.where(here, over, matrix[k] * over)
        swept = jnp.where(here[None], -(column * over)[:, None], matrix - column[:, None] * row[None])
        return jnp.where(here[:, None], row[None], swept), jnp.minimum(smallest, pivot)

    return jax.lax.fori_loop(0, matrix.shape[0], sweep, (matrix, jnp.full((), jnp.inf, matrix.dtype)))


def _start(program: Program) -> _State:
    """Nothing active but the least violation, in the last place."""
    n = program.slope.shape[0]
    last = jnp.arange(n + 1) == n
    corner = jnp.where(last[:, None] & last[None], -1.0, 0.0).astype(program.slope.dtype)
    number = jnp.where(last, program.penalty + program.stiffness * program.least, 0.0)
    row = jnp.full(n + 1, program.total + 2 * n, jnp.int32)
    return _State(
        x=jnp.append(-program.inverse @ program.slope, program.least),
        inverse=jnp.pad(program.inverse, (0, 1)),
        answers=corner,
        active=Active(row, corner, jnp.where(last, -program.least, 0.0), number, last),
        entering=jnp.asarray(-1, jnp.int32),
        force=jnp.zeros_like(program.penalty),
        done=jnp.asarray(False),
        stuck=jnp.asarray(False),
    )


def _weights(program: Program) -> tuple[Array, Array, Scalar]:
    """Of rows and bounds one over the lengths of their gradients, as the Hessian measures them; the softest entry."""
    diagonal = jnp.diagonal(program.inverse)

    def of_slot(slot: Index, found: Array) -> Array:
        rows = program.rows[slot]
        return found.at[slot].set(_inverse_root(jnp.sum((rows @ program.inverse) * rows, axis=1)))

    of_rows = jax.lax.fori_loop(0, program.slots, of_slot, jnp.zeros_like(program.bounds))
    of_box = jnp.append(_inverse_root(jnp.tile(diagonal, 2)), 1.0)
    return of_rows, of_box, jnp.maximum(jnp.max(diagonal), 1 / program.stiffness)


def _inverse_root(x: Array) -> Array:
    return jax.lax.rsqrt(jnp.maximum(x, jnp.finfo(x.dtype).tiny))


def _farthest(program: Program, weights: tuple[Array, Array, Scalar], x: Array) -> Index:
    """The constraint that is violated most, or −1 where none is."""
    d, t = x[:-1], x[-1]

    def worse(best: tuple[Scalar, Index], room: Array, bound: Array, weight: Array, first: Array | int) -> tuple:
        violated = room < -TOLERANCE * (1 + jnp.abs(bound))
        score, place = least(jnp.where(violated, room * weight, 0.0))
        better = score < best[0]
        return jnp.where(better, score, best[0]), jnp.where(better, (first + place).astype(jnp.int32), best[1])

    def of_slot(slot: Index, best: tuple[Scalar, Index]) -> tuple[Scalar, Index]:
        bound = program.bounds[slot]
        room = bound + t - program.rows[slot] @ d
        return worse(best, room, bound, weights[0][slot], slot * bound.shape[0])

    none = jnp.zeros_like(t), jnp.asarray(-1, jnp.int32)
    best = jax.lax.fori_loop(0, program.slots, of_slot, none)
    room = program.box - jnp.concatenate([d, -d, -t[None]])
    return worse(best, room, program.box, weights[1], program.total)[1]


def _constraint(program: Program, row: Index) -> tuple[Float[Array, " q"], Scalar]:
    """The gradient of a constraint in (d, t), and what it bounds."""
    n, count, each = program.slope.shape[0], program.total, program.bounds.shape[1]
    inside = jnp.clip(row, 0, count - 1)
    of_box = jnp.arange(2 * n + 1, dtype=jnp.int32) == row - count
    signs = jnp.where(of_box, 1.0, 0.0).astype(program.slope.dtype)
    of_d = jnp.where(row < count, program.rows[inside // each, inside % each], signs[:n] - signs[n:-1])
    of_t = jnp.where(row < count, -1.0, -signs[-1])
    bound = jnp.where(row < count, program.bounds[inside // each, inside % each], signs @ program.box)
    return jnp.append(of_d, of_t), bound


def _entering(program: Program, softness: Scalar, at: _State, row: Index) -> tuple[_Entering, Flag]:
    """How the constraint is made active, and whether it gives way."""
    normal, bound = _constraint(program, row)
    direction = at.inverse @ normal
    give = normal @ direction
    free = (give > DEPENDENT * softness * (normal @ normal)) & ~jnp.all(at.active.used)
    return _Entering(row, normal, bound, direction, at.answers @ normal, jnp.where(free, give, 1.0)), free


def _advance(program: Program, weights: tuple[Array, Array, Scalar], at: _State) -> _State:
    """One constraint made active, or one dropped that stands in its way; `done` where none is violated."""
    row = jnp.where(at.entering < 0, _farthest(program, weights, at.x), at.entering)
    done = row < 0
    new, free = _entering(program, weights[2], at, row)
    # As far as the constraint is met, or until the multiplier of another one vanishes.
    whole = jnp.where(free, jnp.maximum(new.normal @ at.x - new.room, 0.0) / new.give, jnp.inf)
    shrinks = at.active.used & (new.force > 0)
    nearest, hindering = least(jnp.where(shrinks, at.active.multiplier / jnp.where(shrinks, new.force, 1.0), jnp.inf))
    far = jnp.minimum(whole, nearest)
    stuck = ~done & ~jnp.isfinite(far)
    far = jnp.where(jnp.isfinite(far), far, 0.0)
    adds = whole <= nearest
    place = jnp.where(adds, jnp.argmin(at.active.used).astype(jnp.int32), hindering)
    moved = at._replace(
        x=at.x - jnp.where(free, far, 0.0) * new.direction,
        active=at.active._replace(multiplier=jnp.maximum(at.active.multiplier - far * new.force, 0.0)),
        force=at.force + far,
        done=done,
        stuck=stuck,
    )
    return _changed(program, moved, new, adds, jnp.arange(at.x.shape[0], dtype=jnp.int32) == place, place)


def _changed(program: Program, at: _State, new: _Entering, adds: Flag, here: Bool[Array, " q"], place: Index) -> _State:
    """The entering constraint taken into a place, or the one in that place dropped: a change of rank one."""
    u = at.answers[place]
    bent = jnp.append(program.hessian @ u[:-1], program.stiffness * u[-1])
    bend = u @ bent
    bend = jnp.where(bend > 0, bend, 1.0)
    along = jnp.where(adds, new.direction, u)
    answer = jnp.where(adds, new.force / new.give, at.answers @ bent / bend)
    entered = jnp.where(adds, new.direction / new.give, 0.0)
    old = at.active
    return at._replace(
        inverse=at.inverse + jnp.where(adds, -1 / new.give, 1 / bend) * along[:, None] * along[None],
        answers=jnp.where(here[:, None], entered[None], at.answers - answer[:, None] * along[None]),
        active=Active(
            row=jnp.where(here, new.row, old.row),
            normal=jnp.where(here[:, None], new.normal[None], old.normal),
            room=jnp.where(here, new.room, old.room),
            multiplier=jnp.where(here, jnp.where(adds, at.force, 0.0), old.multiplier),
            used=jnp.where(here, adds, old.used),
        ),
        entering=jnp.where(adds, -1, new.row),
        force=jnp.where(adds, 0.0, at.force),
    )


def _balanced(program: Program, at: _State) -> Flag:
    """Whether the active constraints are met and their multipliers hold the slope: rounding may have spoilt them."""
    held = jnp.where(at.active.used, at.active.multiplier, 0.0) @ at.active.normal
    slope = jnp.append(program.hessian @ at.x[:-1] + program.slope, program.stiffness * at.x[-1] + program.penalty)
    left = jnp.where(at.active.used, at.active.room - at.active.normal @ at.x, 0.0)
    size = 1 + program.penalty + jnp.max(jnp.abs(program.slope))
    return jnp.maximum(jnp.max(jnp.abs(slope + held)), jnp.max(jnp.abs(left))) < UNBALANCED * size  # false for NaN
