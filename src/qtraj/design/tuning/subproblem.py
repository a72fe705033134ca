"""One SQP step: a convex quadratic program (QP) in the step d and the allowed violation t, corrected by a second QP."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import qp
from qtraj.design.tuning.model import PER_LIMIT, Constraints, Model, values_nearby
from qtraj.design.tuning.peaks import PEAKS
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import LimitSlots, Task
from qtraj.foundation.types import Flag, Scalar

FAR = 1e3  # in units of the trust radius: the step cannot reach a constraint this far away

ACTIVE = 1e-7  # a constraint with a larger multiplier is active
AT_BOUND = 1e-7  # a variable closer to a bound is at the bound
PENALISED = 0.9  # multipliers with a larger sum, relative to the penalty, mean that the limits cannot be met yet
MAX_STIFFNESS = 1e-4  # curvature in t, which keeps the QP strictly convex
MIN_PIVOT = 1e-7  # smallest pivot of an accepted Hessian, relative to its largest entry
REGULARIZATION = ((0.0, 0.0), (1.0, 0.0), (30.0, 0.0), (1e3, 0.0), (1e2, 0.01), (10.0, 0.1), (1.0, 1.0), (0.0, 10.0))
"""Regularizations of the Hessian, tried in turn: weights of the squares of active constraints and of the identity."""

PerPeak = Float[Array, "slots peaks"]
PerConstraint = Float[Array, "slots r"]


class Step(NamedTuple):
    """A step, with the multipliers, the allowed violation, and the predicted decrease of the merit function."""

    d: Variables
    multipliers: PerConstraint
    allowed_violation: Scalar
    predicted_decrease: Scalar
    solved: Flag  # false where rounding spoilt a QP, and the step may not be optimal
    residual: Scalar  # of the gradient of the Lagrangian, over the penalty
    remaining: Scalar  # estimated distance to the solution after this step, from the size of the correction
    effort: Int[Array, ""]  # steps that the QP solver took


class _Sums(NamedTuple):
    """Sums over the active peaks.

    `products` sums the outer products of (slope, value, 1) with itself; `hessian` is weighted by the multipliers.
    """

    products: Float[Array, "n+2 n+2"]
    hessian: Float[Array, "n n"]


class _Trial(NamedTuple):
    """The result of the previous QP: the step, the constraint values after it, and the multipliers of the peaks."""

    d: Variables
    value: PerConstraint
    multipliers: PerPeak


class _QPResult(NamedTuple):
    """The solution of one QP, in the units of the tuning problem."""

    multipliers: PerConstraint
    allowed_violation: Scalar
    violation: Scalar  # the largest value of the linearised constraints after the step
    imbalance: Variables  # gradient of the Lagrangian
    correction: Scalar  # the size of the part of d that this QP added
    solved: Flag
    steps: Int[Array, ""]


def compute_step(
    task: Task, slots: LimitSlots, z: Variables, model: Model, multipliers: PerPeak, penalty: Scalar, radius: Scalar
) -> Step:
    """The step from `z`: the solution of a QP about `z`, corrected by a second QP about the point that it reaches.

    The second QP uses the true constraint values at that point, at peaks that drift along, and slopes extrapolated by
    the constraints' Hessians.
    """

    def correct(at: _Trial, last: Flag) -> tuple[_Trial, _QPResult]:
        d, result = _solve(task, slots, z, model, at, penalty, radius)
        there = jax.lax.cond(last, lambda: at.value, lambda: values_nearby(task, slots, z + d, d, model.constraints))
        return _Trial(d, there, result.multipliers[:, :PEAKS]), result

    start = _Trial(jnp.zeros_like(z), model.constraints.value, multipliers)
    end, both = jax.lax.scan(correct, start, jnp.asarray([False, True]))
    last: _QPResult = jax.tree.map(lambda x: x[-1], both)
    d = end.d
    largest = jnp.maximum(jnp.max(model.constraints.value), 0.0)
    cost = task.weight * (model.slope @ d + 0.5 * d @ (model.curvature @ d))
    inside = (z > task.low + AT_BOUND) & (z < task.high - AT_BOUND)
    size = jnp.max(jnp.abs(d))
    return Step(
        d=d,
        multipliers=last.multipliers,
        allowed_violation=last.allowed_violation,
        predicted_decrease=penalty * (largest - last.violation) - cost,
        solved=jnp.all(both.solved),
        residual=jnp.max(jnp.abs(jnp.where(inside, last.imbalance, 0.0))) / jnp.maximum(penalty, 1.0),
        # Assumes that further corrections shrink by the same factor as from the first QP to the second.
        remaining=jnp.where(last.correction < size, last.correction**2 / jnp.where(size > 0, size, 1.0), size),
        effort=jnp.sum(both.steps, dtype=jnp.int32),
    )


def _solve(
    task: Task, slots: LimitSlots, z: Variables, model: Model, at: _Trial, penalty: Scalar, radius: Scalar
) -> tuple[Variables, _QPResult]:
    """Solve the QP about a trial point, whose constraint values are evaluated and whose slopes are extrapolated."""
    is_free = jnp.where(task.high > task.low, 1.0, 0.0).astype(z.dtype)
    largest = jnp.maximum(jnp.max(at.value), 0.0)
    sums, slopes = _sums(slots, model.constraints, at, is_free, largest)
    slope_sum, squares = sums.products[:-2, -1], sums.products[:-2, :-2]
    penalised = jnp.sum(at.multipliers) > PENALISED * penalty
    # Where all active values move with t, they are measured from their mean.
    inv_count = jnp.where(penalised, 1 / jnp.maximum(sums.products[-1, -1], 1.0), 0.0)
    lagrangian = task.weight * model.curvature + sums.hessian
    lagrangian = lagrangian * is_free[:, None] * is_free[None] + jnp.diag(1.0 - is_free)
    hessian, inverse, square_weight = _convex(lagrangian, squares - inv_count * slope_sum[:, None] * slope_sum[None])

    # Values relative to the current violation, in units of the radius and of a large penalty: numbers near one.
    scale = jnp.maximum(penalty, 1.0)
    low, high = jnp.maximum(task.low - z, -radius) - at.d, jnp.minimum(task.high - z, radius) - at.d
    offset = sums.products[:-2, -2] - inv_count * sums.products[-1, -2] * slope_sum
    cost_slope = task.weight * (model.slope + model.curvature @ at.d) * is_free
    scaled = hessian * (radius / scale)
    solution = qp.minimise(
        qp.QP(
            hessian=scaled,
            inverse=inverse * (scale / radius),
            gradient=(cost_slope + square_weight * offset) / scale,
            normals=slopes,
            bounds=jnp.minimum((largest - at.value) / radius, FAR),
            n_slots=jnp.asarray(slots.count),
            low=low / radius,
            high=high / radius,
            penalty=penalty / scale,
            stiffness=jnp.minimum(jnp.trace(scaled) / z.shape[0], MAX_STIFFNESS),
            min_violation=jnp.maximum(-largest / radius, -FAR),
        )
    )
    correction = jnp.where(high > low, jnp.clip(solution.d * radius, low, high), 0.0)
    mean = inv_count * (sums.products[-1, -2] + slope_sum @ correction)
    multipliers, reaction, violation = _multipliers(
        slots, at, slopes, correction, solution.active, scale, square_weight, largest + mean
    )
    # The multipliers never need to exceed the penalty; an inaccurate QP solution must not either.
    part = jnp.minimum(1.0, penalty / jnp.maximum(jnp.sum(multipliers), penalty))
    d = at.d + correction
    return d, _QPResult(
        multipliers=multipliers * part,
        allowed_violation=largest + solution.t * radius,
        violation=jnp.maximum(violation, 0.0),
        imbalance=task.weight * (model.slope + model.curvature @ d) + part * reaction,
        correction=jnp.max(jnp.abs(correction)),
        solved=solution.solved,
        steps=solution.steps,
    )


def _sums(
    slots: LimitSlots, constraints: Constraints, at: _Trial, is_free: Variables, largest: Scalar
) -> tuple[_Sums, Float[Array, "slots r n"]]:
    """Sums over the active peaks, and the slopes of all constraints, extrapolated to the trial point."""
    n = is_free.shape[0]

    def of_slot(slot: Int[Array, ""], carry: tuple[_Sums, Array]) -> tuple[_Sums, Array]:
        sums, slopes = carry
        multiplier, curvature = at.multipliers[slot], constraints.curvature[slot]
        slope = (constraints.slope[slot] + jnp.pad(curvature @ at.d, ((0, PER_LIMIT - PEAKS), (0, 0)))) * is_free[None]
        below = at.value[slot][:PEAKS] - largest
        stacked = jnp.concatenate([slope[:PEAKS], below[:, None], jnp.ones_like(below)[:, None]], axis=1)
        stacked = jnp.where((multiplier > ACTIVE)[:, None], stacked, 0.0)
        weighted = jnp.sum(multiplier[:, None, None] * curvature, axis=0)
        return _Sums(sums.products + stacked.T @ stacked, sums.hessian + weighted), slopes.at[slot].set(slope)

    empty = _Sums(jnp.zeros((n + 2, n + 2), is_free.dtype), jnp.zeros((n, n), is_free.dtype))
    return jax.lax.fori_loop(0, jnp.asarray(slots.count), of_slot, (empty, jnp.zeros_like(constraints.slope)))


def _multipliers(
    slots: LimitSlots,
    at: _Trial,
    slopes: Float[Array, "slots r n"],
    correction: Variables,
    active: qp.Active,
    scale: Scalar,
    square_weight: Scalar,
    mean: Scalar,
) -> tuple[PerConstraint, Variables, Scalar]:
    """The multipliers of all constraints, the sum of multiplier·slope, and the largest linearised value after the QP.

    The squares of active peaks that were added to the Hessian contribute a part of their multipliers.
    """
    active_multipliers = jnp.where(active.used, active.multiplier, 0.0) * scale

    def of_slot(slot: Int[Array, ""], carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        multipliers, reaction, max_linear = carry
        indices = slot * PER_LIMIT + jnp.arange(PER_LIMIT, dtype=jnp.int32)
        linearised = at.value[slot] + slopes[slot] @ correction
        from_squares = jnp.where(at.multipliers[slot] > ACTIVE, square_weight * (linearised[:PEAKS] - mean), 0.0)
        from_qp = jnp.where(active.constraint[None] == indices[:, None], 1.0, 0.0) @ active_multipliers
        own = jnp.maximum(from_qp + jnp.pad(from_squares, (0, PER_LIMIT - PEAKS)), 0.0)
        return (
            multipliers.at[slot].set(own),
            reaction + own @ slopes[slot],
            jnp.maximum(max_linear, jnp.max(linearised)),
        )

    empty = jnp.zeros_like(at.value), jnp.zeros_like(correction), jnp.full_like(scale, -jnp.inf)
    return jax.lax.fori_loop(0, jnp.asarray(slots.count), of_slot, empty)


def _convex(
    lagrangian: Float[Array, "n n"], squares: Float[Array, "n n"]
) -> tuple[Float[Array, "n n"], Float[Array, "n n"], Scalar]:
    """The Hessian, made positive definite, its inverse, and the weight of the squares in it."""
    square_weights, unit_weights = jnp.asarray(REGULARIZATION, lagrangian.dtype).T
    identity = jnp.eye(lagrangian.shape[0], dtype=lagrangian.dtype)
    size = jnp.maximum(jnp.max(jnp.abs(lagrangian)), 1.0)
    added = square_weights[:, None, None] * squares[None] + unit_weights[:, None, None] * identity[None]
    hessians = lagrangian[None] + size * added
    inverses, pivots = jax.vmap(qp.inverse)(hessians)
    chosen = jnp.argmax(pivots > MIN_PIVOT * size)
    return hessians[chosen], inverses[chosen], size * square_weights[chosen]
