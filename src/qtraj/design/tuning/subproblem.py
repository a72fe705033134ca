"""The quadratic program of one step of the search: where to go from a point, and what the limits pull with there."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import quadratic
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.rows import Rows, values_nearby
from qtraj.design.tuning.task import Task
from qtraj.foundation.types import Flag, Scalar

FAR = 1e3  # in units of the trust: a row this far away is not reached

ACTIVE = 1e-7  # a multiplier above this takes its row for active
AT_BOUND = 1e-7  # a variable this near to a bound stands on it
ELASTIC = 0.9  # of the penalty: multipliers with this sum are those of limits that cannot be met yet
OF_EXCESS = 1e-4  # a little curvature of t keeps the program strictly convex
CONVEX = 1e-7  # least pivot, of the largest entry, of a Hessian that is used as it is
LADDER = ((0.0, 0.0), (1.0, 0.0), (30.0, 0.0), (1e3, 0.0), (1e2, 0.01), (10.0, 0.1), (1.0, 1.0), (0.0, 10.0))
"""What is added to a Hessian, in turn: so much of the squares of active rows, so much of the identity."""


class Model(NamedTuple):
    """The problem about one point: the cost with two derivatives, the rows, the Hessians of peaks and ends."""

    cost: Scalar
    slope: Variables
    curvature: Float[Array, "n n"]
    rows: Rows
    hessians: Float[Array, "limits k n n"]


class Move(NamedTuple):
    """A step, the multipliers of the rows there, the excess it allows, and the decrease of the merit it promises."""

    d: Variables
    multipliers: Float[Array, " m"]
    allowed: Scalar
    promise: Scalar
    solved: Flag  # or else rounding spoilt a program, and the step may not be the best one
    residual: Scalar  # of the stationarity that the multipliers leave, over the penalty
    left: Scalar  # of the way, as far as the second program's correction of the first tells
    effort: Int[Array, ""]  # steps that the programs took


class _Trial(NamedTuple):
    """Where the programs so far have led: the step, the values of the rows there, and the multipliers of the peaks."""

    d: Variables
    values: Float[Array, " m"]
    pulls: Float[Array, "limits k"]


class _Ended(NamedTuple):
    """How one program ended: all of it in the problem's own units."""

    d: Variables
    multipliers: Float[Array, " m"]
    allowed: Scalar
    excess: Scalar  # the largest that the rows, taken for straight, have there
    correction: Scalar  # the size of this program's own part of d
    slopes: Float[Array, "m n"]  # of the rows, as the program had them
    solved: Flag
    steps: Int[Array, ""]


def best_move(
    task: Task, z: Variables, model: Model, multipliers: Float[Array, "limits k"], penalty: Scalar, trust: Scalar
) -> Move:
    """The step from `z`: that of the program there, and that of the program about where the first one leads.

    The second knows the true values of the rows, their peaks followed, and their slopes as the Hessians foretell them.
    """

    def correct(at: _Trial, last: Flag) -> tuple[_Trial, _Ended]:
        near = _foretold(model, at)
        program = _program(task, near, at.pulls, penalty)
        e, allowed, found, end = _solve(program, at.values, _box(task, z, at.d, trust), trust)
        d = at.d + e
        excess = jnp.maximum(jnp.max(at.values + near.rows.slope @ e), 0.0)
        there = jax.lax.cond(
            last, lambda: at.values, lambda: values_nearby(task.problem, task.limits, z + d, model.rows)
        )
        pulls = _of_peaks(found, multipliers).reshape(multipliers.shape)
        ended = _Ended(d, found, allowed, excess, jnp.max(jnp.abs(e)), near.rows.slope, end.solved, end.steps)
        return _Trial(d, there, pulls), ended

    start = _Trial(jnp.zeros_like(z), model.rows.value, multipliers)
    _, both = jax.lax.scan(correct, start, jnp.asarray([False, True]))
    end = jax.tree.map(lambda x: x[-1], both)
    gained = penalty * (jnp.maximum(jnp.max(model.rows.value), 0.0) - end.excess)
    cost = task.weight * (model.slope @ end.d + 0.5 * end.d @ model.curvature @ end.d)
    balance = task.weight * (model.slope + model.curvature @ end.d) + end.multipliers @ end.slopes
    inside = (z > task.low + AT_BOUND) & (z < task.high - AT_BOUND)
    return Move(
        d=end.d,
        multipliers=end.multipliers,
        allowed=end.allowed,
        promise=gained - cost,
        solved=jnp.all(both.solved),
        residual=jnp.max(jnp.abs(jnp.where(inside, balance, 0.0))) / jnp.maximum(penalty, 1.0),
        left=_left(jnp.max(jnp.abs(end.d)), end.correction),
        effort=jnp.sum(both.steps),
    )


def _left(size: Scalar, correction: Scalar) -> Scalar:
    """What is left of the way where corrections go on to shrink as they did from the first program to the second."""
    return jnp.where(correction < size, correction**2 / jnp.where(size > 0, size, 1.0), size)


def _of_rows(x: Float[Array, "limits k *rest"], number: int) -> Float[Array, "m *rest"]:
    """What belongs to peaks and ends as one for each of so many rows, zero for those at fixed times."""
    each = number // x.shape[0]
    return jnp.pad(x, ((0, 0), (0, each - x.shape[1]), *((0, 0),) * (x.ndim - 2))).reshape(-1, *x.shape[2:])


def _of_peaks(x: Float[Array, "m *rest"], like: Float[Array, "limits k"]) -> Float[Array, "peaks *rest"]:
    """Of what belongs to the rows, the part of peaks and ends, of which there are as many as of `like`."""
    limits, peaks = like.shape
    return x.reshape(limits, -1, *x.shape[1:])[:, :peaks].reshape(-1, *x.shape[1:])


def _foretold(model: Model, at: _Trial) -> Model:
    """The model about the trial: its values are known, its slopes follow from the second derivatives."""
    bent = _of_rows(model.hessians @ at.d, at.values.shape[0])
    rows = model.rows._replace(value=at.values, slope=model.rows.slope + bent)
    return model._replace(slope=model.slope + model.curvature @ at.d, rows=rows)


def _box(task: Task, z: Variables, d: Variables, trust: Scalar) -> tuple[Variables, Variables]:
    """Bounds on a step from z + d that stays within the trust about z and the bounds of the problem."""
    return jnp.maximum(task.low - z, -trust) - d, jnp.minimum(task.high - z, trust) - d


class _Program(NamedTuple):
    """The quadratic program in (d, t) about a point, but for the values of its rows and its box."""

    hessian: Float[Array, "n n"]
    slope: Variables
    penalty: Scalar
    slopes: Float[Array, "m n"]  # J d − t ≤ −g
    active: Float[Array, "limits k"]  # 1 for the active peaks and ends, else 0
    centred: Float[Array, "peaks n"]  # their slopes
    squared: Scalar  # how much of their squares is in the Hessian
    elastic: Scalar  # 1 where these are measured from their mean, which moves with t, or 0


def _program(task: Task, model: Model, multipliers: Float[Array, "limits k"], penalty: Scalar) -> _Program:
    free = jnp.where(task.high > task.low, 1.0, 0.0).astype(model.slope.dtype)
    slopes = model.rows.slope * free[None]
    lagrangian = task.weight * model.curvature + jnp.einsum("lk,lkij->ij", multipliers, model.hessians)
    lagrangian = lagrangian * jnp.outer(free, free) + jnp.diag(1.0 - free)
    active = jnp.where(multipliers > ACTIVE, 1.0, 0.0).astype(model.slope.dtype)
    elastic = jnp.where(jnp.sum(multipliers) > ELASTIC * penalty, 1.0, 0.0).astype(model.slope.dtype)
    centred = _centred(_of_peaks(slopes, active), active, elastic)
    hessian, squared = _convex(lagrangian, centred)
    return _Program(hessian, task.weight * model.slope * free, penalty, slopes, active, centred, squared, elastic)


def _centred(x: Array, active: Float[Array, "limits k"], elastic: Scalar) -> Array:
    """What belongs to active peaks, and zero elsewhere; from their mean where t moves with them."""
    of_each = active.reshape(-1)
    mean = of_each @ x / jnp.maximum(jnp.sum(of_each), 1.0)
    return of_each.reshape(-1, *(1,) * (x.ndim - 1)) * (x - elastic * mean[None])


def _solve(
    program: _Program, values: Float[Array, " m"], box: tuple[Variables, Variables], trust: Scalar
) -> tuple[Variables, Scalar, Float[Array, " m"], quadratic.Solution]:
    """The step, the excess it allows, the multipliers of the rows, and the scaled solution they are from."""
    # Against the present excess, in units of the trust, and of the penalty where that is large: numbers near one.
    present = jnp.maximum(jnp.max(values), 0.0)
    below = values - present
    low, high = box
    length, force = trust, jnp.maximum(program.penalty, 1.0)
    offset = _centred(_of_peaks(below, program.active), program.active, program.elastic)
    slope = program.slope + program.squared * (offset @ program.centred)
    hessian = program.hessian * (length / force)
    scaled = quadratic.minimise(
        quadratic.Program(
            hessian=hessian,
            slope=slope / force,
            rows=program.slopes,
            bounds=jnp.minimum(-below / length, FAR),
            low=low / length,
            high=high / length,
            penalty=program.penalty / force,
            stiffness=jnp.minimum(jnp.trace(hessian) / hessian.shape[0], OF_EXCESS),
            least=jnp.maximum(-present / length, -FAR),
        )
    )
    d = jnp.where(high > low, jnp.clip(scaled.d * length, low, high), 0.0)
    of_squares = (program.squared * (offset + program.centred @ d)).reshape(program.active.shape)
    found = jnp.maximum(scaled.multipliers * force + _of_rows(of_squares, values.shape[0]), 0.0)
    # No more than the penalty is ever needed: a program solved badly must not leave more behind.
    found = found * jnp.minimum(1.0, program.penalty / jnp.maximum(jnp.sum(found), program.penalty))
    return d, present + scaled.t * length, found, scaled


def _convex(lagrangian: Float[Array, "n n"], rows: Float[Array, "m n"]) -> tuple[Float[Array, "n n"], Scalar]:
    """The Hessian, made positive definite, and how much of the squares of `rows` it took."""
    n = lagrangian.shape[0]
    squares, identities = (jnp.asarray(column, lagrangian.dtype) for column in zip(*LADDER, strict=True))
    of_rows = rows.T @ rows
    unit = jnp.eye(n, dtype=lagrangian.dtype)
    scale = jnp.maximum(jnp.max(jnp.abs(lagrangian)), 1.0)

    def rung(a: Scalar, b: Scalar) -> Float[Array, "n n"]:
        return lagrangian + scale * (a * of_rows + b * unit)

    chosen = jnp.argmax(jax.vmap(lambda a, b: quadratic.least_pivot(rung(a, b)))(squares, identities) > CONVEX * scale)
    convex = rung(squares[chosen], identities[chosen])
    return convex, scale * squares[chosen]
