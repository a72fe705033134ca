"""Small elastic quadratic programs (QPs), solved by the dual active-set method of Goldfarb and Idnani (1983).

The method starts from the minimum with only the lower bound of the violation t active. In each step the method makes
the most violated constraint active, and drops active constraints whose multiplier would become negative. After a few
steps the method reaches the solution to within rounding errors, for any penalty and any box, or reports a failure.
Violations are measured in the metric of the Hessian, so that fewer constraints become active and are dropped again
later.

The constraints are grouped in slots. All QPs of a batch use the same number of slots; all other slots are ignored.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.indexing import choose, element, with_element
from qtraj.foundation.types import Flag, Scalar

MAX_STEPS = 60
FEASIBILITY = 1e-12  # tolerance on constraints; a QP should be scaled to numbers near one
MAX_KKT_RESIDUAL = 1e-7  # largest residual of the KKT conditions at a solution, relative to gradient and penalty
MIN_RATE = 1e-13  # a normal n with a smaller relative nᵀ·inverse·n is linearly dependent on the active constraints

Index = Int[Array, ""]
Vector = Float[Array, " n"]
Matrix = Float[Array, "n n"]


class QP(NamedTuple):
    """The QP min ½dᵀHd + cᵀd + ½εt² + νt subject to normals·d − t ≤ bounds, low ≤ d ≤ high and t ≥ min_violation.

    The variables are the step d and the violation t. H must be positive definite; `inverse` is H⁻¹. With ε > 0 the QP
    is strictly convex in t, too. ν + ε·min_violation must be positive.
    """

    hessian: Matrix
    inverse: Matrix
    gradient: Vector  # c
    normals: Float[Array, "slots r n"]
    bounds: Float[Array, "slots r"]
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
        """The right-hand sides of the upper bounds, the lower bounds and the bound on the violation t."""
        return jnp.concatenate([self.high, -self.low, -self.min_violation[None]])


class Active(NamedTuple):
    """The active constraints; `used` marks the elements of the arrays that are in use.

    `constraint` contains indices into the list of slot constraints, upper bounds, lower bounds and t ≥ min_violation.
    """

    constraint: Int[Array, " q"]
    normal: Float[Array, "q q"]  # gradients with respect to (d, t)
    bound: Float[Array, " q"]  # right-hand sides
    multiplier: Float[Array, " q"]
    used: Bool[Array, " q"]


class Solution(NamedTuple):
    """The optimal step d and violation t, the active constraints, whether the QP is solved, and the number of steps."""

    d: Vector
    t: Scalar
    active: Active
    solved: Flag
    steps: Index


class _State(NamedTuple):
    """The state of the solver; x = (d, t) is the minimum with the active constraints as equalities.

    `inverse` and `pseudo_inverse` are H and N* of Goldfarb and Idnani: the reduced inverse Hessian, and the operator
    from a gradient to the multipliers.
    """

    x: Float[Array, " q"]
    inverse: Float[Array, "q q"]
    pseudo_inverse: Float[Array, "q q"]
    active: Active
    entering: Index  # the constraint that is to become active, or −1
    entering_multiplier: Scalar
    done: Flag
    stuck: Flag  # the QP is too badly scaled to make a constraint active or to drop one


class _Entering(NamedTuple):
    """A constraint that is to become active.

    Per unit of this constraint's multiplier, x changes by −direction and the active multipliers by −dual_direction.
    """

    constraint: Index
    normal: Float[Array, " q"]
    bound: Scalar
    direction: Float[Array, " q"]
    dual_direction: Float[Array, " q"]
    rate: Scalar  # rate of decrease of the constraint's value


def minimise(qps: QP, n_slots: Index) -> Solution:
    """Solve a batch of QPs with constraints in the first `n_slots` slots."""
    weights = _inverse_lengths(qps, n_slots)

    def is_running(state: _State, count: Index) -> Bool[Array, " batch"]:
        return ~state.done & (count < MAX_STEPS)

    def step(state: tuple[_State, Index]) -> tuple[_State, Index]:
        at, count = state
        on = is_running(at, count)
        violated = _most_violated(qps, n_slots, weights, at.x)
        after = jax.vmap(_advance)(qps, weights[2], at, jnp.where(at.entering < 0, violated, at.entering))
        stops = on & (after.done | after.stuck)
        chosen = choose(on & ~stops, after, at)
        return chosen._replace(done=at.done | stops, stuck=at.stuck | (on & after.stuck)), count + on.astype(
            count.dtype
        )

    start = jax.vmap(_start)(qps), jnp.zeros(qps.penalty.shape, jnp.int32)
    end, steps = jax.lax.while_loop(lambda s: jnp.any(is_running(*s)), step, start)
    solved = end.done & ~end.stuck & jax.vmap(_is_optimal)(qps, end)
    return Solution(end.x[:, :-1], end.x[:, -1], end.active, solved, steps)


def inverse(matrices: Float[Array, "*batch n n"]) -> tuple[Float[Array, "*batch n n"], Float[Array, "*batch"]]:
    """Return the inverses of positive definite matrices by the sweep operator, and the smallest pivots.

    As in Gaussian elimination, all pivots are positive if and only if the matrix is positive definite.
    """
    n, last = matrices.shape[-1], matrices.ndim - 1
    places = jnp.arange(n, dtype=jnp.uint32)

    def sweep(k: Index, now: tuple[Array, Array]) -> tuple[Array, Array]:
        matrix, min_pivot = now
        here = jnp.expand_dims(places == k, range(last - 1))
        row, column = element(matrix, k, last - 1), element(matrix, k, last)
        pivot = element(row, k, last - 1)
        over = (1 / jnp.where(pivot == 0, 1.0, pivot))[..., None]
        row = jnp.where(here, over, row * over)[..., None, :]
        updated = jnp.where(here[..., None, :], -(column * over)[..., None], matrix - column[..., None] * row)
        return jnp.where(here[..., None], row, updated), jnp.minimum(min_pivot, pivot)

    start = matrices, jnp.full(matrices.shape[:-2], jnp.inf, matrices.dtype)
    return jax.lax.fori_loop(np.uint32(0), np.uint32(n), sweep, start)


def _start(qp: QP) -> _State:
    """Return the state in which only the lower bound of the violation is active, as the last element."""
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


def _inverse_lengths(qps: QP, n_slots: Index) -> tuple[Array, Array, Array]:
    """Return the inverse norms of all constraint gradients in the metric H⁻¹, and max(1/ε, largest entry of H⁻¹)."""
    diagonal = jnp.sum(qps.inverse * np.eye(qps.inverse.shape[1])[None], axis=2)

    def of_slot(slot: Index, lengths: Array) -> Array:
        normals = element(qps.normals, slot, 1)
        own = _inverse_root(jnp.sum((normals @ qps.inverse) * normals, axis=2))
        return with_element(lengths, slot, own, 1)

    of_slots = jax.lax.fori_loop(jnp.zeros_like(n_slots), n_slots, of_slot, jnp.zeros_like(qps.bounds))
    of_box = _inverse_root(jnp.concatenate([diagonal, diagonal, jnp.ones_like(diagonal[:, :1])], axis=1))
    return of_slots, of_box, jnp.maximum(jnp.max(diagonal, axis=1), 1 / qps.stiffness)


def _inverse_root(x: Array) -> Array:
    return jax.lax.rsqrt(jnp.maximum(x, jnp.finfo(x.dtype).tiny))


def _most_violated(qps: QP, n_slots: Index, weights: tuple[Array, Array, Array], x: Array) -> Int[Array, " batch"]:
    """Return the index of the most violated constraint of each QP, or −1 if none is violated."""
    d, t = x[:, :-1], x[:, -1:]

    def worse(best: tuple[Array, Array], slack: Array, bound: Array, weight: Array, first: Array | int) -> tuple:
        violated = slack < -FEASIBILITY * (1 + jnp.abs(bound))
        score, place = min_and_argmin(jnp.where(violated, slack * weight, 0.0), 1)
        better = score < best[0]
        return jnp.where(better, score, best[0]), jnp.where(better, first + place, best[1])

    def of_slot(slot: Index, best: tuple[Array, Array]) -> tuple[Array, Array]:
        bound, normals, weight = element((qps.bounds, qps.normals, weights[0]), slot, 1)
        slack = bound + t - jnp.einsum("brn,bn->br", normals, d)
        return worse(best, slack, bound, weight, slot.astype(jnp.int32) * bound.shape[1])

    none = jnp.zeros_like(x[:, 0]), jnp.full(x.shape[0], -1, jnp.int32)
    best = jax.lax.fori_loop(jnp.zeros_like(n_slots), n_slots, of_slot, none)
    box = jax.vmap(lambda qp: qp.box)(qps)
    return worse(best, box - jnp.concatenate([d, -d, -t], axis=1), box, weights[1], qps.normals[0, :, :, 0].size)[1]


def _constraint(qp: QP, index: Index) -> tuple[Float[Array, " q"], Scalar]:
    """Return the gradient of a constraint with respect to (d, t), and its bound."""
    n, count = qp.gradient.shape[0], qp.n_constraints
    inside = jnp.clip(index, 0, count - 1)
    of_box = jnp.arange(2 * n + 1, dtype=jnp.int32) == index - count
    signs = jnp.where(of_box, 1.0, 0.0).astype(qp.gradient.dtype)
    of_d = jnp.where(index < count, qp.normals.reshape(-1, n)[inside], signs[:n] - signs[n:-1])
    of_t = jnp.where(index < count, -1.0, -signs[-1])
    bound = jnp.where(index < count, qp.bounds.reshape(-1)[inside], signs @ qp.box)
    return jnp.append(of_d, of_t), bound


def _entering(qp: QP, max_inverse: Scalar, at: _State, index: Index) -> tuple[_Entering, Flag]:
    """Return a constraint that is to become active, and whether it is linearly independent of all active ones."""
    normal, bound = _constraint(qp, index)
    direction = at.inverse @ normal
    rate = normal @ direction
    free = (rate > MIN_RATE * max_inverse * (normal @ normal)) & ~jnp.all(at.active.used)
    return _Entering(index, normal, bound, direction, at.pseudo_inverse @ normal, jnp.where(free, rate, 1.0)), free


def _advance(qp: QP, max_inverse: Scalar, at: _State, index: Index) -> _State:
    """Make the constraint `index` active, or drop one that blocks it; the QP is solved if `index` is −1."""
    done = index < 0
    candidate, free = _entering(qp, max_inverse, at, index)
    # Step until the constraint is satisfied, or until the multiplier of an active constraint becomes zero.
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
    """Return the state after the candidate became the element `place`, or after this element was dropped."""
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
    """Check whether the active constraints are satisfied and the multipliers balance the gradient."""
    reaction = jnp.where(at.active.used, at.active.multiplier, 0.0) @ at.active.normal
    gradient = jnp.append(qp.hessian @ at.x[:-1] + qp.gradient, qp.stiffness * at.x[-1] + qp.penalty)
    residual = jnp.where(at.active.used, at.active.bound - at.active.normal @ at.x, 0.0)
    size = 1 + qp.penalty + jnp.max(jnp.abs(qp.gradient))
    # The comparison is false for NaN.
    return jnp.maximum(jnp.max(jnp.abs(gradient + reaction)), jnp.max(jnp.abs(residual))) < MAX_KKT_RESIDUAL * size
