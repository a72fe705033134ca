"""Small elastic quadratic programs (QPs), solved by the dual active-set method of Goldfarb and Idnani (1983).

The method starts from the minimum with only the lower bound of the violation t active. In each step it makes the most
violated constraint active, and drops active constraints whose multiplier would turn negative. It ends after a few steps
at the solution, to rounding, for any penalty and any box, and reports whether it did. Violations are measured in the
metric of the Hessian: then fewer constraints enter that are dropped again later.

The constraints come in slots, of which only the first `n_slots` are used.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.types import Flag, Scalar

MAX_STEPS = 60
FEASIBILITY = 1e-12  # tolerance on constraints; a QP should be scaled to numbers near one
MAX_KKT_RESIDUAL = 1e-7  # largest residual of the KKT conditions at a solution, relative to gradient and penalty
MIN_RATE = 1e-13  # below this relative rate a constraint is linearly dependent on the active ones

Index = Int[Array, ""]
Vector = Float[Array, " n"]
Matrix = Float[Array, "n n"]


class QP(NamedTuple):
    """min ½dᵀHd + cᵀd + ½εt² + νt subject to normals·d − t ≤ bounds, low ≤ d ≤ high and t ≥ min_violation.

    H is positive definite and comes with its inverse. ε > 0 keeps the QP strictly convex in t as well, and
    ν + ε·min_violation must be positive.
    """

    hessian: Matrix
    inverse: Matrix
    gradient: Vector  # c
    normals: Float[Array, "slots r n"]
    bounds: Float[Array, "slots r"]
    n_slots: Index  # number of slots in use
    low: Vector
    high: Vector
    penalty: Scalar  # ν
    stiffness: Scalar  # ε
    min_violation: Scalar

    @property
    def n_constraints(self) -> int:
        """The number of constraints in all slots, without the box."""
        return self.bounds.size

    @property
    def box(self) -> Float[Array, " k"]:
        """The bounds that follow those of the slots: upper, lower, and the smallest violation."""
        return jnp.concatenate([self.high, -self.low, -self.min_violation[None]])


class Active(NamedTuple):
    """The active constraints, each in a place of its own.

    `constraint` counts slot after slot, then the upper and lower bounds, then t ≥ min_violation.
    """

    constraint: Int[Array, " q"]
    normal: Float[Array, "q q"]  # gradients in (d, t)
    bound: Float[Array, " q"]  # right-hand sides
    multiplier: Float[Array, " q"]
    used: Bool[Array, " q"]


class Solution(NamedTuple):
    """The solution d and t, the active constraints, whether the QP was solved, and the number of steps."""

    d: Vector
    t: Scalar
    active: Active
    solved: Flag
    steps: Index


class _State(NamedTuple):
    """The minimum x = (d, t) with the active constraints as equalities.

    `inverse` and `pseudo_inverse` are H and N* of Goldfarb and Idnani: the reduced inverse Hessian, and the operator
    from a gradient to the multipliers.
    """

    x: Float[Array, " q"]
    inverse: Float[Array, "q q"]
    pseudo_inverse: Float[Array, "q q"]
    active: Active
    entering: Index  # the constraint that is being made active, or −1
    entering_multiplier: Scalar
    done: Flag
    stuck: Flag  # no constraint can enter or be dropped: the QP is too badly scaled


class _Entering(NamedTuple):
    """A constraint that is made active.

    Per unit of its multiplier, x moves by −direction and the multipliers of the others by −dual_direction.
    """

    constraint: Index
    normal: Float[Array, " q"]
    bound: Scalar
    direction: Float[Array, " q"]
    dual_direction: Float[Array, " q"]
    rate: Scalar  # of decrease of the constraint's value


def minimise(qp: QP) -> Solution:
    """Solve a QP."""
    weights = _inverse_lengths(qp)

    def step(state: tuple[_State, Index]) -> tuple[_State, Index]:
        at, count = state
        after = _advance(qp, weights, at)
        stops = after.done | after.stuck
        chosen = jax.tree.map(lambda candidate, old: jnp.where(stops, old, candidate), after, at)
        return chosen._replace(done=stops, stuck=after.stuck), count + 1

    start = (_start(qp), jnp.asarray(0, jnp.int32))
    end, steps = jax.lax.while_loop(lambda s: ~s[0].done & (s[1] < MAX_STEPS), step, start)
    return Solution(end.x[:-1], end.x[-1], end.active, end.done & ~end.stuck & _is_optimal(qp, end), steps)


def inverse(matrix: Matrix) -> tuple[Matrix, Scalar]:
    """The inverse of a positive definite matrix by the sweep operator, and the smallest pivot.

    The pivots are those of Gaussian elimination: all are positive if and only if the matrix is positive definite.
    """
    places = jnp.arange(matrix.shape[0], dtype=jnp.int32)

    def sweep(k: Index, now: tuple[Matrix, Scalar]) -> tuple[Matrix, Scalar]:
        matrix, min_pivot = now
        here = places == k
        pivot = matrix[k, k]
        over = 1 / jnp.where(pivot == 0, 1.0, pivot)
        column, row = matrix[:, k], jnp.where(here, over, matrix[k] * over)
        updated = jnp.where(here[None], -(column * over)[:, None], matrix - column[:, None] * row[None])
        return jnp.where(here[:, None], row[None], updated), jnp.minimum(min_pivot, pivot)

    return jax.lax.fori_loop(0, matrix.shape[0], sweep, (matrix, jnp.full((), jnp.inf, matrix.dtype)))


def _start(qp: QP) -> _State:
    """The state in which only the lower bound of the violation is active, in the last place."""
    n = qp.gradient.shape[0]
    last = jnp.arange(n + 1) == n
    corner = jnp.where(last[:, None] & last[None], -1.0, 0.0).astype(qp.gradient.dtype)
    multipliers = jnp.where(last, qp.penalty + qp.stiffness * qp.min_violation, 0.0)
    index = jnp.full(n + 1, qp.n_constraints + 2 * n, jnp.int32)
    return _State(
        x=jnp.append(-qp.inverse @ qp.gradient, qp.min_violation),
        inverse=jnp.pad(qp.inverse, (0, 1)),
        pseudo_inverse=corner,
        active=Active(index, corner, jnp.where(last, -qp.min_violation, 0.0), multipliers, last),
        entering=jnp.asarray(-1, jnp.int32),
        entering_multiplier=jnp.zeros_like(qp.penalty),
        done=jnp.asarray(False),
        stuck=jnp.asarray(False),
    )


def _inverse_lengths(qp: QP) -> tuple[Array, Array, Scalar]:
    """One over the lengths of the gradients of all constraints in the Hessian's metric; the largest inverse entry."""
    diagonal = jnp.diagonal(qp.inverse)

    def of_slot(slot: Index, lengths: Array) -> Array:
        normals = qp.normals[slot]
        return lengths.at[slot].set(_inverse_root(jnp.sum((normals @ qp.inverse) * normals, axis=1)))

    of_slots = jax.lax.fori_loop(0, qp.n_slots, of_slot, jnp.zeros_like(qp.bounds))
    of_box = jnp.append(_inverse_root(jnp.tile(diagonal, 2)), 1.0)
    return of_slots, of_box, jnp.maximum(jnp.max(diagonal), 1 / qp.stiffness)


def _inverse_root(x: Array) -> Array:
    return jax.lax.rsqrt(jnp.maximum(x, jnp.finfo(x.dtype).tiny))


def _most_violated(qp: QP, weights: tuple[Array, Array, Scalar], x: Array) -> Index:
    """The index of the most violated constraint, or −1 where none is violated."""
    d, t = x[:-1], x[-1]

    def worse(best: tuple[Scalar, Index], slack: Array, bound: Array, weight: Array, first: Array | int) -> tuple:
        violated = slack < -FEASIBILITY * (1 + jnp.abs(bound))
        score, place = min_and_argmin(jnp.where(violated, slack * weight, 0.0))
        better = score < best[0]
        return jnp.where(better, score, best[0]), jnp.where(better, (first + place).astype(jnp.int32), best[1])

    def of_slot(slot: Index, best: tuple[Scalar, Index]) -> tuple[Scalar, Index]:
        bound = qp.bounds[slot]
        slack = bound + t - qp.normals[slot] @ d
        return worse(best, slack, bound, weights[0][slot], slot * bound.shape[0])

    none = jnp.zeros_like(t), jnp.asarray(-1, jnp.int32)
    best = jax.lax.fori_loop(0, qp.n_slots, of_slot, none)
    slack = qp.box - jnp.concatenate([d, -d, -t[None]])
    return worse(best, slack, qp.box, weights[1], qp.n_constraints)[1]


def _constraint(qp: QP, index: Index) -> tuple[Float[Array, " q"], Scalar]:
    """The gradient of a constraint in (d, t), and its bound."""
    n, count, each = qp.gradient.shape[0], qp.n_constraints, qp.bounds.shape[1]
    inside = jnp.clip(index, 0, count - 1)
    of_box = jnp.arange(2 * n + 1, dtype=jnp.int32) == index - count
    signs = jnp.where(of_box, 1.0, 0.0).astype(qp.gradient.dtype)
    of_d = jnp.where(index < count, qp.normals[inside // each, inside % each], signs[:n] - signs[n:-1])
    of_t = jnp.where(index < count, -1.0, -signs[-1])
    bound = jnp.where(index < count, qp.bounds[inside // each, inside % each], signs @ qp.box)
    return jnp.append(of_d, of_t), bound


def _entering(qp: QP, max_inverse: Scalar, at: _State, index: Index) -> tuple[_Entering, Flag]:
    """The directions in which a constraint is made active, and whether it is independent of the active constraints."""
    normal, bound = _constraint(qp, index)
    direction = at.inverse @ normal
    rate = normal @ direction
    free = (rate > MIN_RATE * max_inverse * (normal @ normal)) & ~jnp.all(at.active.used)
    return _Entering(index, normal, bound, direction, at.pseudo_inverse @ normal, jnp.where(free, rate, 1.0)), free


def _advance(qp: QP, weights: tuple[Array, Array, Scalar], at: _State) -> _State:
    """Make one constraint active, or drop one that blocks it; `done` where none is violated."""
    index = jnp.where(at.entering < 0, _most_violated(qp, weights, at.x), at.entering)
    done = index < 0
    candidate, free = _entering(qp, weights[2], at, index)
    # Until the constraint is satisfied, or until the multiplier of an active one vanishes.
    full_step = jnp.where(free, jnp.maximum(candidate.normal @ at.x - candidate.bound, 0.0) / candidate.rate, jnp.inf)
    decreases = at.active.used & (candidate.dual_direction > 0)
    dual_step, blocking = min_and_argmin(
        jnp.where(decreases, at.active.multiplier / jnp.where(decreases, candidate.dual_direction, 1.0), jnp.inf)
    )
    step_length = jnp.minimum(full_step, dual_step)
    stuck = ~done & ~jnp.isfinite(step_length)
    step_length = jnp.where(jnp.isfinite(step_length), step_length, 0.0)
    is_full = full_step <= dual_step
    place = jnp.where(is_full, jnp.argmin(at.active.used).astype(jnp.int32), blocking)
    moved = at._replace(
        x=at.x - jnp.where(free, step_length, 0.0) * candidate.direction,
        active=at.active._replace(
            multiplier=jnp.maximum(at.active.multiplier - step_length * candidate.dual_direction, 0.0)
        ),
        entering_multiplier=at.entering_multiplier + step_length,
        done=done,
        stuck=stuck,
    )
    return _updated(qp, moved, candidate, is_full, jnp.arange(at.x.shape[0], dtype=jnp.int32) == place, place)


def _updated(qp: QP, at: _State, candidate: _Entering, is_full: Flag, here: Bool[Array, " q"], place: Index) -> _State:
    """The state after the candidate entered at a place, or the constraint there was dropped: a rank-one update."""
    u = at.pseudo_inverse[place]
    curved = jnp.append(qp.hessian @ u[:-1], qp.stiffness * u[-1])
    curvature = u @ curved
    curvature = jnp.where(curvature > 0, curvature, 1.0)
    along = jnp.where(is_full, candidate.direction, u)
    correction = jnp.where(is_full, candidate.dual_direction / candidate.rate, at.pseudo_inverse @ curved / curvature)
    dual_row = jnp.where(is_full, candidate.direction / candidate.rate, 0.0)
    old = at.active
    return at._replace(
        inverse=at.inverse + jnp.where(is_full, -1 / candidate.rate, 1 / curvature) * along[:, None] * along[None],
        pseudo_inverse=jnp.where(here[:, None], dual_row[None], at.pseudo_inverse - correction[:, None] * along[None]),
        active=Active(
            constraint=jnp.where(here, candidate.constraint, old.constraint),
            normal=jnp.where(here[:, None], candidate.normal[None], old.normal),
            bound=jnp.where(here, candidate.bound, old.bound),
            multiplier=jnp.where(here, jnp.where(is_full, at.entering_multiplier, 0.0), old.multiplier),
            used=jnp.where(here, is_full, old.used),
        ),
        entering=jnp.where(is_full, -1, candidate.constraint),
        entering_multiplier=jnp.where(is_full, 0.0, at.entering_multiplier),
    )


def _is_optimal(qp: QP, at: _State) -> Flag:
    """Whether the active constraints are met and the multipliers balance the gradient: rounding may spoil either."""
    reaction = jnp.where(at.active.used, at.active.multiplier, 0.0) @ at.active.normal
    gradient = jnp.append(qp.hessian @ at.x[:-1] + qp.gradient, qp.stiffness * at.x[-1] + qp.penalty)
    residual = jnp.where(at.active.used, at.active.bound - at.active.normal @ at.x, 0.0)
    size = 1 + qp.penalty + jnp.max(jnp.abs(qp.gradient))
    return (
        jnp.maximum(jnp.max(jnp.abs(gradient + reaction)), jnp.max(jnp.abs(residual))) < MAX_KKT_RESIDUAL * size
    )  # false for NaN
