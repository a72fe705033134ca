"""Compute one SQP step by two convex quadratic programs (QPs) in the step d and the allowed violation t."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import qp
from qtraj.design.tuning.model import PER_LIMIT, Constraints, Model, values_nearby
from qtraj.design.tuning.peaks import PEAKS
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import LimitSlots, Task, over_slots
from qtraj.foundation.indexing import element, with_element
from qtraj.foundation.types import Flag, Scalar

FAR = 1e3  # a constraint at this distance, in trust radii, is out of reach of a step

ACTIVE = 1e-7  # a constraint with a multiplier above this value is active
AT_BOUND = 1e-7  # a variable within this distance of a bound is at the bound
PENALISED = 0.9  # above this ratio of the multiplier sum to the penalty, the limits cannot be satisfied yet
MAX_STIFFNESS = 1e-4  # upper limit of ε in the term ½εt² that makes the QP strictly convex in the violation t
MIN_PIVOT = 1e-7  # smallest pivot of an accepted Hessian, relative to its largest entry
REGULARIZATION = ((0.0, 0.0), (1.0, 0.0), (30.0, 0.0), (1e3, 0.0), (1e2, 0.01), (10.0, 0.1), (1.0, 1.0), (0.0, 10.0))
"""Regularizations of the Hessian in the order of trial: weights of the squared active constraints and of the identity.
"""

PerPeak = Float[Array, "*batch slots peaks"]
PerConstraint = Float[Array, "*batch slots r"]


class Step(NamedTuple):
    """A step `d` with its multipliers, allowed violation and predicted decrease of the merit function."""

    d: Variables
    multipliers: PerConstraint
    allowed_violation: Scalar
    predicted_decrease: Scalar
    solved: Flag  # false if a QP failed because of rounding errors, so that the step may not be optimal
    residual: Scalar  # largest component of the gradient of the Lagrangian, divided by the penalty
    remaining: Scalar  # estimated distance from the solution after this step
    effort: Int[Array, ""]  # number of steps of the QP solver


class _Sums(NamedTuple):
    """Sums over the active peaks.

    `products` is the sum of v vᵀ over the peaks, with v = (slope, value − largest value, 1). `hessian` is the sum of
    the Hessians weighted by the multipliers.
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
    violation: Scalar  # largest value of the linearised constraints after the step
    imbalance: Variables  # gradient of the Lagrangian
    correction: Scalar  # size of the change of d by this QP
    solved: Flag
    steps: Int[Array, ""]


def compute_step(
    tasks: Task, slots: LimitSlots, z: Array, model: Model, multipliers: PerPeak, penalty: Array, radius: Array
) -> Step:
    """Compute the steps of a batch of searches, each by a QP about its `z` and a second QP that corrects the step.

    The second QP is about the end point of the first step. It uses the true constraint values at this point and at the
    updated times of the peaks. The slopes are extrapolated with the Hessians of the constraints.
    """

    def correct(at: _Trial, last: Flag) -> tuple[_Trial, _QPResult]:
        d, result = _solve(tasks, slots, z, model, at, penalty, radius)
        there = jax.lax.cond(last, lambda: at.value, lambda: values_nearby(tasks, slots, z + d, d, model.constraints))
        return _Trial(d, there, result.multipliers[..., :PEAKS]), result

    start = _Trial(jnp.zeros_like(z), model.constraints.value, multipliers)
    end, both = jax.lax.scan(correct, start, jnp.asarray([False, True]))
    return jax.vmap(_step, (0, 0, 0, 0, 0, 1))(tasks, z, model, penalty, end.d, both)


def _step(task: Task, z: Variables, model: Model, penalty: Scalar, d: Variables, both: _QPResult) -> Step:
    """Return the step `d` of one search, with data from the results of both QPs."""
    last: _QPResult = jax.tree.map(lambda x: x[-1], both)
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
        # Assume that further corrections decrease by the same factor as from the first to the second QP.
        remaining=jnp.where(last.correction < size, last.correction**2 / jnp.where(size > 0, size, 1.0), size),
        effort=jnp.sum(both.steps, dtype=jnp.int32),
    )


def _solve(
    tasks: Task, slots: LimitSlots, z: Array, model: Model, at: _Trial, penalty: Array, radius: Array
) -> tuple[Array, _QPResult]:
    """Solve the QPs about trial points, with evaluated constraint values and extrapolated slopes."""
    is_free = jnp.where(tasks.high > tasks.low, 1.0, 0.0).astype(z.dtype)
    largest = jnp.maximum(jnp.max(at.value, axis=(1, 2)), 0.0)
    sums, slopes = _sums(slots, model.constraints, at, is_free, largest)
    lagrangian, squares, shift = jax.vmap(_hessian)(tasks.weight, model.curvature, at, penalty, is_free, sums)
    convex = _convex(lagrangian, squares)
    qps = jax.vmap(_quadratic_program)(tasks, z, model, at, penalty, radius, is_free, slopes, largest, convex, shift)
    solution = qp.minimise(qps, jnp.asarray(slots.count))
    low, high = qps.low * radius[:, None], qps.high * radius[:, None]
    correction = jnp.where(high > low, jnp.clip(solution.d * radius[:, None], low, high), 0.0)
    mean = shift.inv_count * (sums.products[:, -1, -2] + jnp.sum(shift.slope_sum * correction, axis=1))
    multipliers, reaction, violation = _multipliers(
        slots, at, slopes, correction, solution.active, jnp.maximum(penalty, 1.0), convex[2], largest + mean
    )
    # The sum of the multipliers never needs to exceed the penalty, so scale down the multipliers of an inaccurate QP
    # solution.
    part = jnp.minimum(1.0, penalty / jnp.maximum(jnp.sum(multipliers, axis=(1, 2)), penalty))
    d = at.d + correction
    cost_slope = model.slope + jnp.einsum("bij,bj->bi", model.curvature, d)
    return d, _QPResult(
        multipliers=multipliers * part[:, None, None],
        allowed_violation=largest + solution.t * radius,
        violation=jnp.maximum(violation, 0.0),
        imbalance=tasks.weight[:, None] * cost_slope + part[:, None] * reaction,
        correction=jnp.max(jnp.abs(correction), axis=1),
        solved=solution.solved,
        steps=solution.steps,
    )


class _Shift(NamedTuple):
    """The change of the gradient due to the squares of the active peaks.

    If the limits cannot be satisfied yet, `inv_count` is the inverse of the number of active peaks, and otherwise 0.
    `slope_sum` is the sum of the slopes of the active peaks, and `offset` is the gradient of half the sum of the
    squares of their values.
    """

    inv_count: Scalar
    slope_sum: Variables
    offset: Variables


def _hessian(
    weight: Scalar, curvature: Array, at: _Trial, penalty: Scalar, is_free: Variables, sums: _Sums
) -> tuple[Array, Array, _Shift]:
    """Return the Hessians of the Lagrangian and of the squares of the active peaks, and the change of the gradient."""
    slope_sum, squares = sums.products[:-2, -1], sums.products[:-2, :-2]
    penalised = jnp.sum(at.multipliers) > PENALISED * penalty
    # While the limits cannot be satisfied, all active constraint values equal the violation t: subtract their mean.
    inv_count = jnp.where(penalised, 1 / jnp.maximum(sums.products[-1, -1], 1.0), 0.0)
    lagrangian = weight * curvature + sums.hessian
    lagrangian = lagrangian * is_free[:, None] * is_free[None] + (1.0 - is_free)[None] * np.eye(is_free.shape[0])
    offset = sums.products[:-2, -2] - inv_count * sums.products[-1, -2] * slope_sum
    shift = _Shift(inv_count, slope_sum, offset)
    return lagrangian, squares - inv_count * slope_sum[:, None] * slope_sum[None], shift


def _quadratic_program(
    task: Task,
    z: Variables,
    model: Model,
    at: _Trial,
    penalty: Scalar,
    radius: Scalar,
    is_free: Variables,
    slopes: Float[Array, "slots r n"],
    largest: Scalar,
    convex: tuple[Array, Array, Scalar],
    shift: _Shift,
) -> qp.QP:
    """Return the QP of one problem in units of the trust radius and the penalty, with bounds relative to `largest`."""
    hessian, inverse, square_weight = convex
    scale = jnp.maximum(penalty, 1.0)
    cost_slope = task.weight * (model.slope + model.curvature @ at.d) * is_free
    scaled = hessian * (radius / scale)
    return qp.QP(
        hessian=scaled,
        inverse=inverse * (scale / radius),
        gradient=(cost_slope + square_weight * shift.offset) / scale,
        normals=slopes,
        bounds=jnp.minimum((largest - at.value) / radius, FAR),
        low=(jnp.maximum(task.low - z, -radius) - at.d) / radius,
        high=(jnp.minimum(task.high - z, radius) - at.d) / radius,
        penalty=penalty / scale,
        stiffness=jnp.minimum(jnp.sum(scaled * np.eye(z.shape[0])) / z.shape[0], MAX_STIFFNESS),
        min_violation=jnp.maximum(-largest / radius, -FAR),
    )


def _sums(
    slots: LimitSlots, constraints: Constraints, at: _Trial, is_free: Array, largest: Array
) -> tuple[_Sums, Float[Array, "batch slots r n"]]:
    """Return sums over the active peaks, and the slopes of all constraints, extrapolated to the trial point."""
    batch, n = is_free.shape

    def of_peaks(
        slope: Array, curvature: Array, multiplier: Array, value: Array, d: Array, is_free: Array, largest: Scalar
    ) -> tuple[Array, Array, Array]:
        slope = (slope + jnp.pad(curvature @ d, ((0, PER_LIMIT - PEAKS), (0, 0)))) * is_free[None]
        below = value[:PEAKS] - largest
        stacked = jnp.concatenate([slope[:PEAKS], below[:, None], jnp.ones_like(below)[:, None]], axis=1)
        stacked = jnp.where((multiplier > ACTIVE)[:, None], stacked, 0.0)
        return stacked.T @ stacked, jnp.sum(multiplier[:, None, None] * curvature, axis=0), slope

    def of_slot(slot: Int[Array, ""], carry: tuple[_Sums, Array]) -> tuple[_Sums, Array]:
        sums, slopes = carry
        parts = constraints.slope, constraints.curvature, at.multipliers, at.value
        own = (*element(parts, slot, 1), at.d, is_free, largest)
        products, weighted, slope = jax.vmap(lambda own: of_peaks(*own))(own)
        return _Sums(sums.products + products, sums.hessian + weighted), with_element(slopes, slot, slope, 1)

    empty = _Sums(jnp.zeros((batch, n + 2, n + 2), is_free.dtype), jnp.zeros((batch, n, n), is_free.dtype))
    return over_slots(slots, of_slot, (empty, jnp.zeros_like(constraints.slope)))


def _multipliers(
    slots: LimitSlots,
    at: _Trial,
    slopes: Float[Array, "batch slots r n"],
    correction: Array,
    active: qp.Active,
    scale: Array,
    square_weight: Array,
    mean: Array,
) -> tuple[PerConstraint, Array, Array]:
    """Return the multipliers of all constraints, the sum of multiplier·slope, and the largest linearised value.

    The squares of active peaks in the Hessian contribute to the multipliers of these peaks.
    """
    active_multipliers = jnp.where(active.used, active.multiplier, 0.0) * scale[:, None]
    places = jnp.arange(PER_LIMIT, dtype=jnp.int32)[None, :, None]

    def of_slot(slot: Int[Array, ""], carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        multipliers, reaction, max_linear = carry
        indices = slot.astype(jnp.int32) * PER_LIMIT + places
        value, slope, old = element((at.value, slopes, at.multipliers), slot, 1)
        linearised = value + jnp.einsum("brn,bn->br", slope, correction)
        squares = square_weight[:, None] * (linearised[:, :PEAKS] - mean[:, None])
        from_squares = jnp.where(old > ACTIVE, squares, 0.0)
        is_active = jnp.where(active.constraint[:, None] == indices, 1.0, 0.0)
        from_qp = jnp.einsum("brq,bq->br", is_active, active_multipliers)
        own = jnp.maximum(from_qp + jnp.pad(from_squares, ((0, 0), (0, PER_LIMIT - PEAKS))), 0.0)
        return (
            with_element(multipliers, slot, own, 1),
            reaction + jnp.einsum("br,brn->bn", own, slope),
            jnp.maximum(max_linear, jnp.max(linearised, axis=1)),
        )

    empty = jnp.zeros_like(at.value), jnp.zeros_like(correction), jnp.full_like(scale, -jnp.inf)
    return over_slots(slots, of_slot, empty)


def _convex(
    lagrangian: Float[Array, "batch n n"], squares: Float[Array, "batch n n"]
) -> tuple[Float[Array, "batch n n"], Float[Array, "batch n n"], Float[Array, " batch"]]:
    """Return positive definite Hessians, their inverses, and the weights of the squares in the Hessians."""
    square_weights, unit_weights = jnp.asarray(REGULARIZATION, lagrangian.dtype).T
    identity = jnp.eye(lagrangian.shape[-1], dtype=lagrangian.dtype)[None]
    size = jnp.maximum(jnp.max(jnp.abs(lagrangian), axis=(1, 2)), 1.0)
    weighted = square_weights[None, :, None, None] * squares[:, None]
    added = weighted + (unit_weights[:, None, None] * identity)[None]
    hessians = lagrangian[:, None] + size[:, None, None, None] * added
    inverses, pivots = qp.inverse(hessians)
    chosen = jnp.argmax(pivots > MIN_PIVOT * size[:, None], axis=1)
    here = chosen[:, None] == jnp.arange(len(REGULARIZATION))[None]

    def own(x: Array) -> Array:
        return jnp.sum(jnp.where(jnp.expand_dims(here, range(2, x.ndim)), x, 0.0), axis=1)

    return own(hessians), own(inverses), size * own(square_weights[None])
