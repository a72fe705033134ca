"""Sequential quadratic programming on polished peaks: the solver of small smooth tuning problems, made for lanes.

It minimises weight·cost + ν·max(0, g₁, …) over a box: an exact penalty, whose largest excess (and not their sum) stays
continuous while peaks come and go. Each step solves a convex quadratic program in the step d and the excess t allowed,
in a box of trust; the Hessian is that of the Lagrangian, exact, with the motion of the peaks. Where it is not positive
definite, squares of the active rows are added first (which does not change the solution where they stay active), and
multiples of the identity when that is not enough. A step that raises what is minimised is refused: the trust shrinks,
and the time where it broke a limit most becomes a row.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import quadratic
from qtraj.design.limits import Limits
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.rows import Peaks, Rows, find_peaks, rows_at, values_at, values_nearby
from qtraj.foundation.types import Flag, Scalar

FIRST_TRUST, LARGEST_TRUST, LEAST_TRUST = 0.5, 2.0, 1e-11
FIRST_PENALTY, PENALTY_GROWTH, HIGHEST_PENALTY = 2.0, 5.0, 1e5

FEASIBLE = 2e-9
"""Largest relative excess over a limit, of ½((value/limit)² − 1), that counts as met."""

FAR = 1e4  # in units of the trust: a row or an excess this far away is not reached
ROUGH, FINE = 8, 14  # steps of interior point, for the first step and for the corrected one

SMALL_STEP = 1e-8
STATIONARY = 1e-6  # of the penalty: so little imbalance counts as none
"""A step of this size, in reference speeds and logarithms of time, ends the search."""

ACTIVE = 1e-7  # a multiplier above this takes its row for active
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
    peaks: Peaks
    rows: Rows
    hessians: Float[Array, "limits k n n"]

    @property
    def excess(self) -> Scalar:
        """The largest excess, or zero where nothing is exceeded."""
        return jnp.maximum(jnp.max(self.rows.value), 0.0)


class State(NamedTuple):
    """Where the search stands; the multipliers are those of peaks and ends."""

    z: Variables
    model: Model
    multipliers: Float[Array, "limits k"]
    trust: Scalar
    penalty: Scalar
    steps: Int[Array, ""]
    done: Flag


class Task(eqx.Module):
    """What is searched: a problem, limits, the box of its variables, and the weight of its cost (0: least excess)."""

    problem: Problem
    limits: Limits
    low: Variables
    high: Variables
    weight: Scalar

    def model(self, z: Variables, peaks: Peaks) -> Model:
        """Cost and rows at `z`."""
        cost = self.problem.cost
        rows, hessians = rows_at(self.problem, self.limits, z, peaks)
        return Model(cost(z), jax.jacfwd(cost)(z), jax.jacfwd(jax.jacfwd(cost))(z), peaks, rows, hessians)


class _Move(NamedTuple):
    """A step, the multipliers of the rows there, the excess it allows, and the decrease of the merit it promises."""

    d: Variables
    multipliers: Float[Array, " m"]
    allowed: Scalar
    promise: Scalar
    residual: Scalar  # of the stationarity that the multipliers leave, over the penalty


def solve(task: Task, z: Variables, most_steps: int) -> State:
    """The search from `z`."""
    return proceed(task, begin(task, z), most_steps)


def begin(task: Task, z: Variables) -> State:
    """The search before its first step."""
    z = jnp.clip(z, task.low, task.high)
    model = task.model(z, find_peaks(task.problem, task.limits, z))
    one = jnp.ones_like(model.cost)
    penalty = jnp.where(task.weight > 0, FIRST_PENALTY, 1.0) * one
    multipliers = jnp.zeros_like(model.peaks.time)
    return State(z, model, multipliers, FIRST_TRUST * one, penalty, jnp.asarray(0), jnp.asarray(False))


def proceed(task: Task, state: State, most_steps: int | Int[Array, ""]) -> State:
    """Steps until the search is done or has taken `most_steps`."""
    return jax.lax.while_loop(lambda s: ~s.done & (s.steps < most_steps), lambda s: step(task, s), state)


def step(task: Task, s: State) -> State:
    """One step, taken or refused."""
    move = _best_move(task, s)
    trial = s.z + move.d
    peaks = find_peaks(task.problem, task.limits, trial)
    values = values_at(task.problem, task.limits, trial, peaks)
    excess = jnp.maximum(jnp.max(values), 0.0)
    before = task.weight * s.model.cost + s.penalty * s.model.excess
    gained = before - task.weight * task.problem.cost(trial) - s.penalty * excess
    rounding = 10 * jnp.finfo(trial.dtype).eps * (jnp.abs(before) + s.penalty)
    flat = (move.promise <= rounding) & (move.residual < STATIONARY)
    taken = (gained >= 0.1 * move.promise - rounding) & ((move.promise > rounding) | flat)
    z = jnp.where(taken, trial, s.z)
    peaks = jax.tree.map(lambda new, old: jnp.where(taken, new, old), peaks, s.model.peaks)
    model = task.model(z, peaks)
    handed = _hand_over(move.multipliers, s.model.rows.time, peaks)
    size = jnp.max(jnp.abs(move.d))
    wide = jnp.maximum(s.trust, jnp.minimum(2.5 * size, LARGEST_TRUST))
    grown = jnp.where(gained >= 0.7 * move.promise - rounding, wide, s.trust)
    trust = jnp.where(taken, grown, 0.3 * jnp.clip(size, 0.1 * s.trust, s.trust))
    still = (taken & (size < SMALL_STEP)) | flat
    penalty, hopeless = _penalty(task, s, move, taken, still & (model.excess > FEASIBLE))
    return State(
        z=z,
        model=model,
        multipliers=jnp.where(taken, handed, s.multipliers),
        trust=trust,
        penalty=penalty,
        steps=s.steps + 1,
        done=(still & ((model.excess <= FEASIBLE) | hopeless)) | (trust < LEAST_TRUST),
    )


def _penalty(task: Task, s: State, move: _Move, taken: Flag, ended_outside: Flag) -> tuple[Scalar, Flag]:
    """The next penalty, larger where it holds the step back from the limits; and whether that is past hope."""
    inside = jnp.max(jnp.abs(move.d)) < 0.5 * s.trust  # or the trust, and not the penalty, holds it back
    pressed = taken & inside & (move.allowed > 0.1 * FEASIBLE) & (jnp.sum(move.multipliers) > 0.5 * s.penalty)
    raised = (pressed | ended_outside) & (task.weight > 0)
    penalty = jnp.where(raised, jnp.minimum(PENALTY_GROWTH * s.penalty, HIGHEST_PENALTY), s.penalty)
    return penalty, (task.weight == 0) | (s.penalty >= HIGHEST_PENALTY)


def _hand_over(multipliers: Float[Array, " m"], times: Float[Array, " m"], peaks: Peaks) -> Float[Array, "limits k"]:
    """The multipliers of the rows, each given to the nearest peak or end there is."""

    def of_limit(own: Float[Array, " r"], at: Float[Array, " r"], there: Peaks) -> Float[Array, " k"]:
        distance = jnp.abs(there.time[:, None] - at) + jnp.where(there.present, 0.0, 2.0)[:, None]
        nearest = jnp.argmin(distance, axis=0)
        return jnp.where(nearest == jnp.arange(there.time.shape[0])[:, None], own, 0.0).sum(axis=1)

    number = peaks.time.shape[0]
    return jax.vmap(of_limit)(multipliers.reshape(number, -1), times.reshape(number, -1), peaks)


def _best_move(task: Task, s: State) -> _Move:
    """The step of the quadratic program about `s`, solved once more with the rows as they are after the first step."""
    program = _program(task, s)
    rows = s.model.rows
    first, _, _ = _solve(program, rows.value, ROUGH)
    bent = values_nearby(task.problem, task.limits, s.z + first, rows) - rows.slope @ first
    d, allowed, multipliers = _solve(program, bent, FINE)
    cost = task.weight * (s.model.slope @ d + 0.5 * d @ s.model.curvature @ d)
    after = jnp.maximum(jnp.max(bent + rows.slope @ d), 0.0)
    balance = task.weight * s.model.slope + multipliers @ rows.slope
    inside = (s.z > task.low) & (s.z < task.high)
    residual = jnp.max(jnp.abs(jnp.where(inside, balance, 0.0))) / jnp.maximum(s.penalty, 1.0)
    return _Move(d, multipliers, allowed, s.penalty * (s.model.excess - after) - cost, residual)


class _Program(NamedTuple):
    """The quadratic program in (d, t) about a point, but for the values of its rows."""

    hessian: Float[Array, "n+1 n+1"]
    slope: Float[Array, " n+1"]
    tilted: Float[Array, "m n+1"]  # J d − t ≤ −g
    squared: Float[Array, " m"]  # how much of each row's square is in the Hessian
    low: Variables
    high: Variables
    trust: Scalar


def _program(task: Task, s: State) -> _Program:
    rows = s.model.rows
    free = jnp.where(task.high > task.low, 1.0, 0.0).astype(s.z.dtype)
    tilted = jnp.concatenate([rows.slope * free, -jnp.ones_like(rows.value)[:, None]], axis=1)
    lagrangian = task.weight * s.model.curvature + jnp.einsum("lk,lkij->ij", s.multipliers, s.model.hessians)
    lagrangian = lagrangian * free * free[:, None] + jnp.diag(1.0 - free)
    active = jnp.where(s.multipliers > ACTIVE, 1.0, 0.0).astype(s.z.dtype)
    active = jnp.pad(active, ((0, 0), (0, rows.value.shape[0] // active.shape[0] - active.shape[1]))).reshape(-1)
    hessian, squares = _convex(lagrangian, tilted, active)
    return _Program(
        hessian=hessian,
        slope=jnp.append(task.weight * s.model.slope * free, s.penalty),
        tilted=tilted,
        squared=squares * active,
        low=jnp.maximum(task.low - s.z, -s.trust),
        high=jnp.minimum(task.high - s.z, s.trust),
        trust=s.trust,
    )


def _solve(program: _Program, values: Float[Array, " m"], steps: int) -> tuple[Variables, Scalar, Float[Array, " m"]]:
    """The step, the excess it allows, and the multipliers of the rows."""
    # In units of the trust, and of the penalty where that is large, every number is near one.
    length, force = program.trust, jnp.maximum(program.slope[-1], 1.0)
    slope = program.slope + (program.squared * values) @ program.tilted
    x, multipliers = quadratic.minimise(
        quadratic.Program(
            hessian=program.hessian * (length / force),
            slope=slope / force,
            rows=program.tilted,
            bounds=jnp.minimum(-values / length, FAR),
            low=jnp.append(program.low / length, 0.0),
            high=jnp.append(program.high / length, FAR),
        ),
        steps,
    )
    x, multipliers = x * length, multipliers * force
    moved = program.squared * (values + program.tilted @ x)
    d = jnp.where(program.high > program.low, jnp.clip(x[:-1], program.low, program.high), 0.0)
    found = jnp.maximum(multipliers + moved, 0.0)
    # No more than the penalty is ever needed: a program solved badly must not leave more behind.
    return d, x[-1], found * jnp.minimum(1.0, program.slope[-1] / jnp.maximum(jnp.sum(found), program.slope[-1]))


def _convex(
    lagrangian: Float[Array, "n n"], tilted: Float[Array, "m n+1"], active: Float[Array, " m"]
) -> tuple[Float[Array, "n+1 n+1"], Scalar]:
    """The Hessian in (d, t), made positive definite in d, and how much of the active rows' squares it took."""
    n = lagrangian.shape[0]
    squares, identities = (jnp.asarray(column, lagrangian.dtype) for column in zip(*LADDER, strict=True))
    of_rows = (tilted.T * active) @ tilted
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
