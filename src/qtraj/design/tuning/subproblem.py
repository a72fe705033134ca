"""The quadratic program of one step of the search: where to go from a point, and what the limits pull with there."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning import quadratic
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.rows import Rows, values_nearby
from qtraj.design.tuning.task import Task
from qtraj.foundation.types import Scalar

FAR = 1e4  # in units of the trust: a row this far away is not reached
CORRECTIONS = 2  # programs solved for one step: about the point, and with the rows as they are after the first
INTERIOR_STEPS = 12

ACTIVE = 1e-7  # a multiplier above this takes its row for active
AT_BOUND = 1e-7  # a variable this near to a bound stands on it
CONVEX = 1e-5  # least pivot of a Hessian that is used as it is
LADDER = (
    (0.0, 0.0),
    (1.0, 0.0),
    (30.0, 0.0),
    (1e3, 0.0),
    (1e2, 0.01),
    (30.0, 0.03),
    (10.0, 0.1),
    (1.0, 0.3),
    (0.0, 1.0),
    (0.0, 3.0),
    (0.0, 10.0),
)
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
    residual: Scalar  # of the stationarity that the multipliers leave, over the penalty


def best_move(
    task: Task, z: Variables, model: Model, multipliers: Float[Array, "limits k"], penalty: Scalar, trust: Scalar
) -> Move:
    """The step from `z`, of a program solved once more with the rows as they are after the first step."""
    program, rows = _program(task, z, model, multipliers, penalty, trust), model.rows

    def correct(bent: Float[Array, " m"], _: None) -> tuple[Float[Array, " m"], tuple[Array, ...]]:
        d, allowed, found = _solve(program, bent)
        after = values_nearby(task.problem, task.limits, z + d, rows) - rows.slope @ d
        return after, (d, allowed, found, jnp.maximum(jnp.max(bent + rows.slope @ d), 0.0))

    _, solved = jax.lax.scan(correct, rows.value, None, length=CORRECTIONS)
    d, allowed, found, after = (x[-1] for x in solved)
    cost = task.weight * (model.slope @ d + 0.5 * d @ model.curvature @ d)
    balance = task.weight * model.slope + found @ rows.slope
    inside = (z > task.low + AT_BOUND) & (z < task.high - AT_BOUND)
    residual = jnp.max(jnp.abs(jnp.where(inside, balance, 0.0))) / jnp.maximum(penalty, 1.0)
    return Move(d, found, allowed, penalty * (jnp.maximum(jnp.max(rows.value), 0.0) - after) - cost, residual)


class _Program(NamedTuple):
    """The quadratic program in (d, t) about a point, but for the values of its rows."""

    hessian: Float[Array, "q q"]
    slope: Float[Array, " q"]
    tilted: Float[Array, "m q"]  # J d − t ≤ −g
    squared: Float[Array, " m"]  # how much of each row's square is in the Hessian
    low: Variables
    high: Variables
    trust: Scalar


def _program(
    task: Task, z: Variables, model: Model, multipliers: Float[Array, "limits k"], penalty: Scalar, trust: Scalar
) -> _Program:
    rows = model.rows
    free = jnp.where(task.high > task.low, 1.0, 0.0).astype(z.dtype)
    tilted = jnp.concatenate([rows.slope * free[None], -jnp.ones_like(rows.value)[:, None]], axis=1)
    lagrangian = task.weight * model.curvature + jnp.einsum("lk,lkij->ij", multipliers, model.hessians)
    lagrangian = lagrangian * jnp.outer(free, free) + jnp.diag(1.0 - free)
    active = jnp.where(multipliers > ACTIVE, 1.0, 0.0).astype(z.dtype)
    active = jnp.pad(active, ((0, 0), (0, rows.value.shape[0] // active.shape[0] - active.shape[1]))).reshape(-1)
    hessian, squares = _convex(lagrangian, tilted, active)
    return _Program(
        hessian=hessian,
        slope=jnp.append(task.weight * model.slope * free, penalty),
        tilted=tilted,
        squared=squares * active,
        low=jnp.maximum(task.low - z, -trust),
        high=jnp.minimum(task.high - z, trust),
        trust=trust,
    )


def _solve(program: _Program, values: Float[Array, " m"]) -> tuple[Variables, Scalar, Float[Array, " m"]]:
    """The step, the excess it allows, and the multipliers of the rows."""
    # Against the present excess, in units of the trust, and of the penalty where that is large: numbers near one.
    present = jnp.maximum(jnp.max(values), 0.0)
    below = values - present
    length, force = program.trust, jnp.maximum(program.slope[-1], 1.0)
    slope = program.slope + (program.squared * below) @ program.tilted
    x, multipliers = quadratic.minimise(
        quadratic.Program(
            hessian=program.hessian * (length / force),
            slope=slope / force,
            rows=program.tilted,
            bounds=jnp.minimum(-below / length, FAR),
            low=jnp.append(program.low / length, jnp.maximum(-present / length, -FAR)),
            high=jnp.append(program.high / length, FAR),
        ),
        INTERIOR_STEPS,
    )
    x, multipliers = x * length, multipliers * force
    moved = program.squared * (below + program.tilted @ x)
    d = jnp.where(program.high > program.low, jnp.clip(x[:-1], program.low, program.high), 0.0)
    found = jnp.maximum(multipliers + moved, 0.0)
    # No more than the penalty is ever needed: a program solved badly must not leave more behind.
    found = found * jnp.minimum(1.0, program.slope[-1] / jnp.maximum(jnp.sum(found), program.slope[-1]))
    return d, present + x[-1], found


def _convex(
    lagrangian: Float[Array, "n n"], tilted: Float[Array, "m q"], active: Float[Array, " m"]
) -> tuple[Float[Array, "q q"], Scalar]:
    """The Hessian in (d, t), made positive definite in d, and how much of the active rows' squares it took."""
    n = lagrangian.shape[0]
    squares, identities = (jnp.asarray(column, lagrangian.dtype) for column in zip(*LADDER, strict=True))
    of_rows = (tilted.T * active[None]) @ tilted
    whole = jnp.zeros((n + 1, n + 1), lagrangian.dtype).at[:n, :n].set(lagrangian)
    bulk = jnp.eye(n, dtype=lagrangian.dtype)

    def least_pivot(a: Scalar, b: Scalar) -> Scalar:
        return jnp.min(quadratic.factor(lagrangian + a * of_rows[:n, :n] + b * bulk).pivots)

    scale = jnp.maximum(jnp.max(jnp.abs(lagrangian)), 1.0)
    squares, identities = scale * squares, scale * identities
    rung = jnp.argmax(jax.vmap(least_pivot)(squares, identities) > CONVEX)
    # A little curvature of t keeps the program strictly convex where no row is active.
    diagonal = jnp.append(jnp.full(n, identities[rung]), 1e-8)
    return whole + squares[rung] * of_rows + jnp.diag(diagonal), squares[rung]
