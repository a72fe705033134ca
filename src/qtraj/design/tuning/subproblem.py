"""The step from a point of the search: a convex quadratic program in the step d and the violation t that it allows."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import quadratic
from qtraj.design.tuning.model import ROWS, Constraints, Model, values_nearby
from qtraj.design.tuning.peaks import PEAKS
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation.types import Flag, Scalar

FAR = 1e3  # in units of the trust radius: a constraint this far away is not reached

ACTIVE = 1e-7  # a multiplier above this takes its constraint for active
AT_BOUND = 1e-7  # a variable this near to a bound stands on it
ELASTIC = 0.9  # of the penalty: multipliers with this sum are those of limits that cannot be met yet
OF_VIOLATION = 1e-4  # a little curvature of t keeps the program strictly convex
CONVEX = 1e-7  # least pivot, of the largest entry, of a Hessian that is used as it is
LADDER = ((0.0, 0.0), (1.0, 0.0), (30.0, 0.0), (1e3, 0.0), (1e2, 0.01), (10.0, 0.1), (1.0, 1.0), (0.0, 10.0))
"""What is added to a Hessian, in turn: so much of the squares of active constraints, so much of the identity."""

OfPeaks = Float[Array, "slots peaks"]
OfRows = Float[Array, "slots rows"]


class Step(NamedTuple):
    """A step, the multipliers there, the violation it allows, and the decrease of the merit function it promises."""

    d: Variables
    multipliers: OfRows
    allowed: Scalar
    promise: Scalar
    solved: Flag  # or else rounding spoilt a program, and the step may not be the best one
    residual: Scalar  # of the stationarity that the multipliers leave, over the penalty
    left: Scalar  # of the way, as far as the second program's correction of the first tells
    effort: Int[Array, ""]  # steps that the programs took


class _Sums(NamedTuple):
    """Sums over the active peaks.

    `products` are those of (slope, value, 1) of each with itself, `hessian` is weighed by the multipliers.
    """

    products: Float[Array, "n+2 n+2"]
    hessian: Float[Array, "n n"]


class _Trial(NamedTuple):
    """Where the programs so far have led: the step, the values of the constraints there, multipliers of the peaks."""

    d: Variables
    value: OfRows
    multipliers: OfPeaks


class _Solved(NamedTuple):
    """The solution of one program, in the problem's own units."""

    multipliers: OfRows
    allowed: Scalar
    violation: Scalar  # the largest that the linearised constraints have there
    imbalance: Variables  # of the slopes of the cost and of the active constraints
    correction: Scalar  # the size of this program's own part of d
    solved: Flag
    steps: Int[Array, ""]


def best_step(
    task: Task, which: Present, z: Variables, model: Model, multipliers: OfPeaks, penalty: Scalar, radius: Scalar
) -> Step:
    """The step from `z`: that of the program there, and that of the program about where the first one leads.

    The second knows the true values of the constraints there, their peaks followed, and their slopes as the Hessians
    foretell them.
    """

    def correct(at: _Trial, last: Flag) -> tuple[_Trial, _Solved]:
        d, found = _solve(task, which, z, model, at, penalty, radius)
        there = jax.lax.cond(last, lambda: at.value, lambda: values_nearby(task, which, z + d, d, model.constraints))
        return _Trial(d, there, found.multipliers[:, :PEAKS]), found

    start = _Trial(jnp.zeros_like(z), model.constraints.value, multipliers)
    end, both = jax.lax.scan(correct, start, jnp.asarray([False, True]))
    last: _Solved = jax.tree.map(lambda x: x[-1], both)
    d = end.d
    present = jnp.maximum(jnp.max(model.constraints.value), 0.0)
    cost = task.weight * (model.slope @ d + 0.5 * d @ (model.curvature @ d))
    inside = (z > task.low + AT_BOUND) & (z < task.high - AT_BOUND)
    size = jnp.max(jnp.abs(d))
    return Step(
        d=d,
        multipliers=last.multipliers,
        allowed=last.allowed,
        promise=penalty * (present - last.violation) - cost,
        solved=jnp.all(both.solved),
        residual=jnp.max(jnp.abs(jnp.where(inside, last.imbalance, 0.0))) / jnp.maximum(penalty, 1.0),
        # What is left where corrections go on to shrink as they did from the first program to the second.
        left=jnp.where(last.correction < size, last.correction**2 / jnp.where(size > 0, size, 1.0), size),
        effort=jnp.sum(both.steps, dtype=jnp.int32),
    )


def _solve(
    task: Task, which: Present, z: Variables, model: Model, at: _Trial, penalty: Scalar, radius: Scalar
) -> tuple[Variables, _Solved]:
    """The program about the trial: its values are known, its slopes follow from the second derivatives."""
    free = jnp.where(task.high > task.low, 1.0, 0.0).astype(z.dtype)
    present = jnp.maximum(jnp.max(at.value), 0.0)
    sums, slopes = _sums(which, model.constraints, at, free, present)
    total, squares = sums.products[:-2, -1], sums.products[:-2, :-2]
    elastic = jnp.sum(at.multipliers) > ELASTIC * penalty
    # Measured from their mean where that moves with t.
    over = jnp.where(elastic, 1 / jnp.maximum(sums.products[-1, -1], 1.0), 0.0)
    lagrangian = task.weight * model.curvature + sums.hessian
    lagrangian = lagrangian * free[:, None] * free[None] + jnp.diag(1.0 - free)
    hessian, inverse, squared = _convex(lagrangian, squares - over * total[:, None] * total[None])

    # Against the present violation, in units of the radius, and of the penalty where that is large: numbers near one.
    force = jnp.maximum(penalty, 1.0)
    low, high = jnp.maximum(task.low - z, -radius) - at.d, jnp.minimum(task.high - z, radius) - at.d
    offset = sums.products[:-2, -2] - over * sums.products[-1, -2] * total
    cost_slope = task.weight * (model.slope + model.curvature @ at.d) * free
    scaled = hessian * (radius / force)
    found = quadratic.minimise(
        quadratic.Program(
            hessian=scaled,
            inverse=inverse * (force / radius),
            slope=(cost_slope + squared * offset) / force,
            rows=slopes,
            bounds=jnp.minimum((present - at.value) / radius, FAR),
            slots=jnp.asarray(which.count),
            low=low / radius,
            high=high / radius,
            penalty=penalty / force,
            stiffness=jnp.minimum(jnp.trace(scaled) / z.shape[0], OF_VIOLATION),
            least=jnp.maximum(-present / radius, -FAR),
        )
    )
    e = jnp.where(high > low, jnp.clip(found.d * radius, low, high), 0.0)
    mean = over * (sums.products[-1, -2] + total @ e)
    dense, held, violation = _outcome(which, at, slopes, e, found.active, force, squared, present + mean)
    # No more than the penalty is ever needed: a program solved badly must not leave more behind.
    part = jnp.minimum(1.0, penalty / jnp.maximum(jnp.sum(dense), penalty))
    d = at.d + e
    return d, _Solved(
        multipliers=dense * part,
        allowed=present + found.t * radius,
        violation=jnp.maximum(violation, 0.0),
        imbalance=task.weight * (model.slope + model.curvature @ d) + part * held,
        correction=jnp.max(jnp.abs(e)),
        solved=found.solved,
        steps=found.steps,
    )


def _sums(
    which: Present, known: Constraints, at: _Trial, free: Variables, present: Scalar
) -> tuple[_Sums, Float[Array, "slots rows n"]]:
    """Sums over the active peaks, and the slopes of all constraints about the trial, as the Hessians foretell them."""
    n = free.shape[0]

    def of_slot(slot: Int[Array, ""], found: tuple[_Sums, Array]) -> tuple[_Sums, Array]:
        sums, slopes = found
        multiplier, curvature = at.multipliers[slot], known.curvature[slot]
        slope = (known.slope[slot] + jnp.pad(curvature @ at.d, ((0, ROWS - PEAKS), (0, 0)))) * free[None]
        below = at.value[slot][:PEAKS] - present
        each = jnp.concatenate([slope[:PEAKS], below[:, None], jnp.ones_like(below)[:, None]], axis=1)
        each = jnp.where((multiplier > ACTIVE)[:, None], each, 0.0)
        weighed = jnp.sum(multiplier[:, None, None] * curvature, axis=0)
        return _Sums(sums.products + each.T @ each, sums.hessian + weighed), slopes.at[slot].set(slope)

    nothing = _Sums(jnp.zeros((n + 2, n + 2), free.dtype), jnp.zeros((n, n), free.dtype))
    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, (nothing, jnp.zeros_like(known.slope)))


def _outcome(
    which: Present,
    at: _Trial,
    slopes: Float[Array, "slots rows n"],
    e: Variables,
    active: quadratic.Active,
    force: Scalar,
    squared: Scalar,
    mean: Scalar,
) -> tuple[OfRows, Variables, Scalar]:
    """The multipliers of all constraints, the sum of slopes times these, and the largest linearised value after e.

    Of active peaks a part of the multipliers stands in the Hessian as their squares.
    """
    number = jnp.where(active.used, active.multiplier, 0.0) * force

    def of_slot(slot: Int[Array, ""], found: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        dense, held, largest = found
        rows = slot * ROWS + jnp.arange(ROWS, dtype=jnp.int32)
        linear = at.value[slot] + slopes[slot] @ e
        of_squares = jnp.where(at.multipliers[slot] > ACTIVE, squared * (linear[:PEAKS] - mean), 0.0)
        of_rows = jnp.where(active.row[None] == rows[:, None], 1.0, 0.0) @ number
        of_rows = jnp.maximum(of_rows + jnp.pad(of_squares, (0, ROWS - PEAKS)), 0.0)
        return dense.at[slot].set(of_rows), held + of_rows @ slopes[slot], jnp.maximum(largest, jnp.max(linear))

    nothing = jnp.zeros_like(at.value), jnp.zeros_like(e), jnp.full_like(force, -jnp.inf)
    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, nothing)


def _convex(
    lagrangian: Float[Array, "n n"], squares: Float[Array, "n n"]
) -> tuple[Float[Array, "n n"], Float[Array, "n n"], Scalar]:
    """The Hessian, made positive definite, its inverse, and how much of the squares it took."""
    of_squares, of_unit = jnp.asarray(LADDER, lagrangian.dtype).T
    unit = jnp.eye(lagrangian.shape[0], dtype=lagrangian.dtype)
    scale = jnp.maximum(jnp.max(jnp.abs(lagrangian)), 1.0)
    added = of_squares[:, None, None] * squares[None] + of_unit[:, None, None] * unit[None]
    rungs = lagrangian[None] + scale * added
    inverses, pivots = jax.vmap(quadratic.inverse)(rungs)
    chosen = jnp.argmax(pivots > CONVEX * scale)
    return rungs[chosen], inverses[chosen], scale * of_squares[chosen]
