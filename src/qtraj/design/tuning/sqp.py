"""Sequential quadratic programming on polished peaks: the solver of small smooth tuning problems, made for lanes.

It minimises weight·cost + ν·max(0, g₁, …) over a box: an exact penalty, whose largest excess (and not their sum) stays
continuous while peaks come and go. Each step solves a convex quadratic program in the step d and the excess t allowed,
in a box of trust; the Hessian is that of the Lagrangian, exact, with the motion of the peaks. Where it is not positive
definite, squares of the active rows are added first (which does not change the solution where they stay active; while
the limits cannot be met, squares of their differences, for then they all move with t), and multiples of the identity
when that is not enough. A second program about where the first one leads corrects the step. A step that raises what is
minimised is refused, and the trust shrinks.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.rows import Peaks, find_peaks, rows_at, values_at
from qtraj.design.tuning.subproblem import ELASTIC, Model, Move, best_move
from qtraj.design.tuning.task import Task
from qtraj.foundation.types import Flag, Scalar

FIRST_TRUST, LARGEST_TRUST, LEAST_TRUST = 0.5, 2.0, 1e-11
FIRST_PENALTY, PENALTY_GROWTH, HIGHEST_PENALTY = 2.0, 5.0, 1e5
SPARE_PENALTY = 3.0  # times the sum of the multipliers: enough once the limits are met

FEASIBLE = 2e-9
"""Largest relative excess over a limit, of ½((value/limit)² − 1), that counts as met."""

SMALL_STEP = 1e-8
"""A step of this size, in reference speeds and logarithms of time, ends the search."""

STATIONARY = 1e-6
"""Of the penalty: so little imbalance between the cost and the pull of the limits counts as none."""


class State(NamedTuple):
    """Where the search stands; values and multipliers are those of peaks and ends."""

    z: Variables
    cost: Scalar
    peaks: Peaks
    values: Float[Array, "limits k"]
    multipliers: Float[Array, "limits k"]
    trust: Scalar
    penalty: Scalar
    steps: Int[Array, ""]
    done: Flag
    settled: Flag  # done at a stationary point

    @property
    def excess(self) -> Float[Array, "*lanes"]:
        """The largest excess, or zero where nothing is exceeded."""
        return jnp.maximum(jnp.max(self.values, axis=(-2, -1)), 0.0)


def solve(task: Task, z: Variables, most_steps: int) -> State:
    """The search from `z`."""
    return proceed(task, begin(task, z), most_steps)


def begin(task: Task, z: Variables) -> State:
    """The search before its first step."""
    z = jnp.clip(z, task.low, task.high)
    peaks = find_peaks(task.problem, task.limits, z)
    cost = task.problem.cost(z)
    return State(
        z=z,
        cost=cost,
        peaks=peaks,
        values=values_at(task.problem, task.limits, z, peaks),
        multipliers=jnp.zeros_like(peaks.time),
        trust=jnp.full_like(cost, FIRST_TRUST),
        penalty=_first_penalty(task),
        steps=jnp.asarray(0),
        done=jnp.asarray(False),
        settled=jnp.asarray(False),
    )


def proceed(task: Task, state: State, most_steps: int | Int[Array, ""]) -> State:
    """Steps until the search is done or has taken `most_steps`."""
    return jax.lax.while_loop(lambda s: ~s.done & (s.steps < most_steps), lambda s: step(task, s), state)


def step(task: Task, s: State) -> State:
    """One step, taken or refused."""
    model = _model(task, s)
    move = best_move(task, s.z, model, s.multipliers, s.penalty, s.trust)
    trial = s.z + move.d
    peaks = find_peaks(task.problem, task.limits, trial)
    there = s._replace(
        z=trial,
        cost=task.problem.cost(trial),
        peaks=peaks,
        values=values_at(task.problem, task.limits, trial, peaks),
        multipliers=_hand_over(move.multipliers, model.rows.time, peaks),
    )
    before = task.weight * s.cost + s.penalty * s.excess
    gained = before - task.weight * there.cost - s.penalty * there.excess
    rounding = 10 * jnp.finfo(trial.dtype).eps * (jnp.abs(before) + s.penalty)
    flat = (move.promise <= rounding) & (move.residual < STATIONARY)
    taken = (gained >= 0.1 * move.promise - rounding) & ((move.promise > rounding) | flat)
    ended: State = jax.tree.map(lambda new, old: jnp.where(taken, new, old), there, s)
    still = (taken & (jnp.max(jnp.abs(move.d)) < SMALL_STEP)) | flat
    trust = _trust(s, move, taken, gained >= 0.7 * move.promise - rounding)
    penalty, hopeless = _penalty(task, s, ended, move, taken, still)
    # What the program last said holds at a flat end as well, where the step itself may be refused.
    here = _hand_over(move.multipliers, model.rows.time, s.peaks)
    multipliers = jnp.where(flat & ~taken, here, ended.multipliers)
    # Where limits cannot be met yet, all the pull is that of the penalty, and grows with it.
    elastic = (ended.excess > FEASIBLE) & (jnp.sum(move.multipliers) > ELASTIC * s.penalty)
    multipliers = multipliers * jnp.where(elastic, penalty / s.penalty, 1.0)
    settled = still & ((ended.excess <= FEASIBLE) | hopeless)
    done = settled | (trust < LEAST_TRUST)
    return ended._replace(
        multipliers=multipliers, trust=trust, penalty=penalty, steps=s.steps + 1, done=done, settled=settled
    )


def _model(task: Task, s: State) -> Model:
    cost = task.problem.cost
    rows, hessians = rows_at(task.problem, task.limits, s.z, s.peaks)
    return Model(s.cost, jax.jacfwd(cost)(s.z), jax.jacfwd(jax.jacfwd(cost))(s.z), rows, hessians)


def _trust(s: State, move: Move, taken: Flag, good: Flag) -> Scalar:
    """The next trust: wider after a step as good as promised, narrower than one refused."""
    size = jnp.max(jnp.abs(move.d))
    wide = jnp.maximum(s.trust, jnp.minimum(2.5 * size, LARGEST_TRUST))
    return jnp.where(taken, jnp.where(good, wide, s.trust), 0.3 * jnp.clip(size, 0.1 * s.trust, s.trust))


def _penalty(task: Task, s: State, ended: State, move: Move, taken: Flag, still: Flag) -> tuple[Scalar, Flag]:
    """The next penalty, and whether it is past hope.

    Larger where it holds the step back from the limits; where they are met, no larger than the multipliers need, or
    steps along a curved limit would have to be short.
    """
    pull = jnp.sum(move.multipliers)
    inside = jnp.max(jnp.abs(move.d)) < 0.5 * s.trust  # or the trust, and not the penalty, holds it back
    pressed = taken & inside & (move.allowed > 0.1 * FEASIBLE) & (pull > 0.5 * s.penalty)
    met = ended.excess <= FEASIBLE
    raised = (pressed | (still & ~met)) & (task.weight > 0)
    penalty = jnp.where(raised, jnp.minimum(PENALTY_GROWTH * s.penalty, HIGHEST_PENALTY), s.penalty)
    lowered = jnp.minimum(jnp.maximum(SPARE_PENALTY * pull, _first_penalty(task)), penalty)
    return jnp.where(taken & met, lowered, penalty), (task.weight == 0) | (s.penalty >= HIGHEST_PENALTY)


def _first_penalty(task: Task) -> Scalar:
    return jnp.where(task.weight > 0, FIRST_PENALTY, 1.0).astype(task.weight.dtype)


def _hand_over(multipliers: Float[Array, " m"], times: Float[Array, " m"], peaks: Peaks) -> Float[Array, "limits k"]:
    """The multipliers of the rows, each given to the nearest peak or end there is."""

    def of_limit(own: Float[Array, " r"], at: Float[Array, " r"], there: Peaks) -> Float[Array, " k"]:
        distance = jnp.abs(there.time[:, None] - at[None]) + jnp.where(there.present, 0.0, 2.0)[:, None]
        nearest = jnp.argmin(distance, axis=0)
        return jnp.where(nearest[None] == jnp.arange(there.time.shape[0])[:, None], own[None], 0.0).sum(axis=1)

    number = peaks.time.shape[0]
    return jax.vmap(of_limit)(multipliers.reshape(number, -1), times.reshape(number, -1), peaks)
