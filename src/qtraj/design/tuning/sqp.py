"""Sequential quadratic programming on polished peaks: the solver of small smooth tuning problems, made for lanes.

It minimises weight·cost + ν·max(0, g₁, …) over a box: an exact penalty, whose largest excess (and not their sum) stays
continuous while peaks come and go. Each step solves a convex quadratic program in the step d and the excess t allowed,
in a box of trust; the Hessian is that of the Lagrangian, exact, with the motion of the peaks. Where it is not positive
definite, squares of the active rows are added first (which does not change the solution where they stay active; while
the limits cannot be met, squares of their differences, for then they all move with t), and multiples of the identity
when that is not enough. A second program about where the first one leads corrects the step. A step that raises what is
minimised is refused, and the trust shrinks.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.rows import Peaks, find_peaks, rows_at, values_at
from qtraj.design.tuning.subproblem import ELASTIC, Model, Move, best_move
from qtraj.design.tuning.task import Task
from qtraj.foundation.derivatives import with_derivatives
from qtraj.foundation.types import Flag, Scalar

FIRST_TRUST, LARGEST_TRUST, LEAST_TRUST = 0.5, 2.0, 1e-11
WIDER, NARROWER = 2.5, 0.3  # the next trust, in sizes of the step taken or refused
ENOUGH, GOOD = 0.1, 0.7  # parts of what a step promised: with less it is refused, with more the trust may grow
FIRST_PENALTY, PENALTY_GROWTH, HIGHEST_PENALTY = 2.0, 5.0, 1e5
SPARE_PENALTY = 3.0  # times the sum of the multipliers: enough once the limits are met

FEASIBLE = 2e-9
"""Largest relative excess over a limit, of ½((value/limit)² − 1), that counts as met."""

SMALL_STEP = 1e-8
"""A step of this size, in reference speeds and logarithms of time, ends the search."""

LAST_STEP, LEFT = 1e-6, 1e-11
"""So does a step as good as promised of the first size, whose square is the error of its slopes, if its corrections let
expect no more than the second to be left of the way."""

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
    eased: Flag  # the penalty has been lowered
    held: Flag  # and raised again, so that it stays
    steps: Int[Array, ""]
    done: Flag
    settled: Flag  # done at a stationary point
    effort: Int[Array, ""]  # of the last step's programs

    @property
    def excess(self) -> Float[Array, "*lanes"]:
        """The largest excess, or zero where nothing is exceeded."""
        return jnp.maximum(jnp.max(self.values, axis=(-2, -1)), 0.0)


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
        eased=jnp.asarray(False),
        held=jnp.asarray(False),
        steps=jnp.asarray(0),
        done=jnp.asarray(False),
        settled=jnp.asarray(False),
        effort=jnp.asarray(0),
    )


def proceed(advance: Callable[[State], State], states: State, most_steps: int | Int[Array, ""]) -> State:
    """Steps of searches side by side (lanes in front), until each of them is done or has taken `most_steps`.

    `advance` takes one step of all. A loop over lanes, and not lanes of loops, is traced in less time.
    """

    def going(s: State) -> Bool[Array, " lanes"]:
        return ~s.done & (s.steps < most_steps)

    def onward(s: State) -> State:
        on = going(s)
        return jax.tree.map(
            lambda new, old: jnp.where(jnp.expand_dims(on, range(1, new.ndim)), new, old), advance(s), s
        )

    return jax.lax.while_loop(lambda s: jnp.any(going(s)), onward, states)


def step(task: Task, s: State) -> State:
    """One step, taken or refused."""
    model = _model(task, s)
    move = best_move(task, s.z, model, s.multipliers, s.penalty, s.trust)
    there = _arrived(task, s, model, move)
    trial = _judged(task, s, there, move)
    ended: State = jax.tree.map(lambda new, old: jnp.where(trial.taken, new, old), there, s)
    # At a flat end, where the step itself may be refused, what the program last said holds for the place as it is.
    flat = trial.flat & ~trial.taken
    ended = ended._replace(
        multipliers=jnp.where(flat, _hand_over(move.multipliers, model.rows.time, s.peaks), ended.multipliers)
    )
    still = (trial.taken & _arrives(s, move, trial)) | trial.flat
    ended = _punished(task, ended, move, trial.taken, still)
    hopeless = (task.weight == 0) | (s.penalty >= HIGHEST_PENALTY)
    settled = still & ((ended.excess <= FEASIBLE) | hopeless)
    trust = _trust(s, move, trial)
    done = settled | (trust < LEAST_TRUST)
    return ended._replace(trust=trust, steps=s.steps + 1, done=done, settled=settled, effort=move.effort)


class _Judgement(NamedTuple):
    """What a step brought: whether it is taken, whether as good as promised, whether there was nothing to win."""

    taken: Flag
    good: Flag
    flat: Flag


def _arrived(task: Task, s: State, model: Model, move: Move) -> State:
    """The state after the step, if it is taken."""
    z = s.z + move.d
    peaks = find_peaks(task.problem, task.limits, z)
    return s._replace(
        z=z,
        cost=task.problem.cost(z),
        peaks=peaks,
        values=values_at(task.problem, task.limits, z, peaks),
        multipliers=_hand_over(move.multipliers, model.rows.time, peaks),
    )


def _judged(task: Task, s: State, there: State, move: Move) -> _Judgement:
    before = task.weight * s.cost + s.penalty * s.excess
    gained = before - task.weight * there.cost - s.penalty * there.excess
    rounding = 10 * jnp.finfo(before.dtype).eps * (jnp.abs(before) + s.penalty)
    flat = move.solved & (move.promise <= rounding) & (move.residual < STATIONARY)
    enough, good = (gained >= part * move.promise - rounding for part in (ENOUGH, GOOD))
    # A program solved badly may still lead downhill, but only one solved well can tell that this is the end.
    taken = enough & ((move.promise > rounding) | flat)
    return _Judgement(taken, good, flat)


def _arrives(s: State, move: Move, judged: _Judgement) -> Flag:
    """Whether a step that is taken leads to where nothing is left to do."""
    size = jnp.max(jnp.abs(move.d))
    last = move.solved & judged.good & (size < jnp.minimum(LAST_STEP, 0.5 * s.trust)) & (move.left < LEFT)
    return (size < SMALL_STEP) | last


def _model(task: Task, s: State) -> Model:
    _, slope, curvature = with_derivatives(task.problem.cost, s.z)
    return Model(s.cost, slope, curvature, *rows_at(task.problem, task.limits, s.z, s.peaks))


def _trust(s: State, move: Move, judged: _Judgement) -> Scalar:
    """The next trust: wider after a step as good as promised, narrower than one refused."""
    size = jnp.max(jnp.abs(move.d))
    wide = jnp.maximum(s.trust, jnp.minimum(WIDER * size, LARGEST_TRUST))
    narrow = NARROWER * jnp.clip(size, 0.1 * s.trust, s.trust)
    return jnp.where(judged.taken, jnp.where(judged.good, wide, s.trust), narrow)


def _punished(task: Task, s: State, move: Move, taken: Flag, still: Flag) -> State:
    """The state with its next penalty.

    Larger where it holds the step back from the limits. Where they are met, no larger than the multipliers need, or
    steps along a curved limit would have to be short; but one that had to be raised again is not lowered any more.
    """
    pull = jnp.sum(move.multipliers)
    inside = jnp.max(jnp.abs(move.d)) < 0.5 * s.trust  # or the trust, and not the penalty, holds it back
    pressed = taken & inside & (move.allowed > 0.1 * FEASIBLE) & (pull > 0.5 * s.penalty)
    met = s.excess <= FEASIBLE
    raised = (pressed | (still & ~met)) & (task.weight > 0)
    penalty = jnp.where(raised, jnp.minimum(PENALTY_GROWTH * s.penalty, HIGHEST_PENALTY), s.penalty)
    lowered = jnp.minimum(jnp.maximum(SPARE_PENALTY * pull, _first_penalty(task)), penalty)
    penalty = jnp.where(taken & met & ~s.held, lowered, penalty)
    # Where limits cannot be met yet, all the pull is that of the penalty, and grows with it.
    growth = jnp.where(~met & (pull > ELASTIC * s.penalty), penalty / s.penalty, 1.0)
    return s._replace(
        penalty=penalty,
        multipliers=s.multipliers * growth,
        eased=s.eased | (penalty < s.penalty),
        held=s.held | (s.eased & (penalty > s.penalty)),
    )


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
