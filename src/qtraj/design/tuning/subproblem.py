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

FAR = 1e3  # in units of the trust: a row this far away is not reached
CORRECTIONS = 2  # programs solved for one step: about the point, and with the rows as they are after the first

ACTIVE = 1e-7  # a multiplier above this takes its row for active
AT_BOUND = 1e-7  # a variable this near to a bound stands on it
ELASTIC = 0.9  # of the penalty: multipliers with this sum are those of limits that cannot be met yet
OF_EXCESS = 1e-4  # a little curvature of t keeps the program strictly convex
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
    rows = model.rows
    padded = jax.vmap(lambda of: jnp.pad(of, ((0, rows.value.shape[0] // model.hessians.shape[0] - of.shape[0]), (0, 0), (0, 0))))(model.hessians)
    bends = padded.reshape(-1, *padded.shape[2:])
    count = multipliers.shape

    def correct(about: tuple[Variables, Array, Array], _: None) -> tuple[tuple[Variables, Array, Array], tuple[Array, ...]]:
        d, values, pulls = about
        near = Model(
            model.cost,
            model.slope + model.curvature @ d,
            model.curvature,
            rows._replace(value=values, slope=rows.slope + bends @ d),
            model.hessians,
        )
        program = _program(task, z, near, pulls, penalty, trust, d)
        e, allowed, found = _solve(program, values)
        after = values_nearby(task.problem, task.limits, z + d + e, rows)
        excess = jnp.maximum(jnp.max(values + near.rows.slope @ e), 0.0)
        return (d + e, after, found.reshape(count[0], -1)[:, : count[1]]), (d + e, allowed, found, excess, near.rows.slope)

    _, solved = jax.lax.scan(correct, (jnp.zeros_like(z), rows.value, multipliers), None, length=CORRECTIONS)
    d, allowed, found, after, slopes = (x[-1] for x in solved)
    cost = task.weight * (model.slope @ d + 0.5 * d @ model.curvature @ d)
    balance = task.weight * (model.slope + model.curvature @ d) + found @ slopes
    inside = (z > task.low + AT_BOUND) & (z < task.high - AT_BOUND)
    residual = jnp.max(jnp.abs(jnp.where(inside, balance, 0.0))) / jnp.maximum(penalty, 1.0)
    return Move(d, found, allowed, penalty * (jnp.maximum(jnp.max(rows.value), 0.0) - after) - cost, residual)


class _Program(NamedTuple):
    """The quadratic program in (d, t) about a point, but for the values of its rows."""

    hessian: Float[Array, "n n"]
    slope: Variables
    penalty: Scalar
    slopes: Float[Array, "m n"]  # J d − t ≤ −g
    active: Float[Array, " m"]  # 1 for the active rows, else 0
    squared: Scalar  # how much of the active rows' squares is in the Hessian
    elastic: Scalar  # 1 where these are measured from their mean, which moves with t, or 0
    low: Variables
    high: Variables
    trust: Scalar


def _program(
    task: Task,
    z: Variables,
    model: Model,
    multipliers: Float[Array, "limits k"],
    penalty: Scalar,
    trust: Scalar,
    moved: Variables,
) -> _Program:
    rows = model.rows
    free = jnp.where(task.high > task.low, 1.0, 0.0).astype(z.dtype)
    slopes = rows.slope * free[None]
    lagrangian = task.weight * model.curvature + jnp.einsum("lk,lkij->ij", multipliers, model.hessians)
    lagrangian = lagrangian * jnp.outer(free, free) + jnp.diag(1.0 - free)
    active = jnp.where(multipliers > ACTIVE, 1.0, 0.0).astype(z.dtype)
    active = jnp.pad(active, ((0, 0), (0, rows.value.shape[0] // active.shape[0] - active.shape[1]))).reshape(-1)
    elastic = jnp.where(jnp.sum(multipliers) > ELASTIC * penalty, 1.0, 0.0).astype(z.dtype)
    hessian, squared = _convex(lagrangian, _centred(slopes, active, elastic))
    return _Program(
        hessian=hessian,
        slope=task.weight * model.slope * free,
        penalty=penalty,
        slopes=slopes,
        active=active,
        squared=squared,
        elastic=elastic,
        low=jnp.maximum(task.low - z, -trust) - moved,
        high=jnp.minimum(task.high - z, trust) - moved,
        trust=trust,
    )


def _centred(x: Array, active: Float[Array, " m"], elastic: Scalar) -> Array:
    """What belongs to active rows, and zero elsewhere; from their mean where t moves with them."""
    weight = active.reshape(-1, *(1,) * (x.ndim - 1))
    mean = jnp.sum(weight * x, axis=0) / jnp.maximum(jnp.sum(active), 1.0)
    return weight * (x - elastic * mean[None])


def _solve(program: _Program, values: Float[Array, " m"]) -> tuple[Variables, Scalar, Float[Array, " m"]]:
    """The step, the excess it allows, and the multipliers of the rows."""
    # Against the present excess, in units of the trust, and of the penalty where that is large: numbers near one.
    present = jnp.maximum(jnp.max(values), 0.0)
    below = values - present
    length, force = program.trust, jnp.maximum(program.penalty, 1.0)
    slopes = _centred(program.slopes, program.active, program.elastic)
    offset = _centred(below, program.active, program.elastic)
    slope = program.slope + program.squared * (offset @ slopes)
    hessian = program.hessian * (length / force)
    d, t, multipliers = quadratic.minimise(
        quadratic.Program(
            hessian=hessian,
            slope=slope / force,
            rows=program.slopes,
            bounds=jnp.minimum(-below / length, FAR),
            low=program.low / length,
            high=program.high / length,
            penalty=program.penalty / force,
            stiffness=jnp.minimum(jnp.trace(hessian) / hessian.shape[0], OF_EXCESS),
            least=jnp.maximum(-present / length, -FAR),
        )
    )
    d = jnp.where(program.high > program.low, jnp.clip(d * length, program.low, program.high), 0.0)
    found = jnp.maximum(multipliers * force + program.squared * (offset + slopes @ d), 0.0)
    # No more than the penalty is ever needed: a program solved badly must not leave more behind.
    found = found * jnp.minimum(1.0, program.penalty / jnp.maximum(jnp.sum(found), program.penalty))
    return d, present + t * length, found


def _convex(lagrangian: Float[Array, "n n"], rows: Float[Array, "m n"]) -> tuple[Float[Array, "n n"], Scalar]:
    """The Hessian, made positive definite, and how much of the squares of `rows` it took."""
    n = lagrangian.shape[0]
    squares, identities = (jnp.asarray(column, lagrangian.dtype) for column in zip(*LADDER, strict=True))
    of_rows = rows.T @ rows
    unit = jnp.eye(n, dtype=lagrangian.dtype)
    scale = jnp.maximum(jnp.max(jnp.abs(lagrangian)), 1.0)

    def rung(a: Scalar, b: Scalar) -> Float[Array, "n n"]:
        return lagrangian + scale * (a * of_rows + b * unit)

    chosen = jnp.argmax(jax.vmap(lambda a, b: quadratic.least_pivot(rung(a, b)))(squares, identities) > CONVEX)
    convex = rung(squares[chosen], identities[chosen])
    return convex, scale * squares[chosen]
