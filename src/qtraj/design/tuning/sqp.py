"""Sequential quadratic programming on refined peaks: the search for small smooth tuning problems, many side by side.

It minimises weight·cost + ν·max(0, g₁, …) over a box: an exact penalty, whose largest violation (and not their sum)
stays continuous while peaks come and go. Each step solves a convex quadratic program in the step d and the violation t
that it allows, within a trust radius; the Hessian is that of the Lagrangian, exact, with the motion of the peaks. Where
it is not positive definite, squares of the active constraints are added first (which does not change the solution where
they stay active; while the limits cannot be met, squares of their differences, for then they all move with t), and
multiples of the identity when that is not enough. A second program about where the first one leads corrects the step. A
step that raises what is minimised is refused, and the trust radius shrinks.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning import model as models, peaks as peaking
from qtraj.design.tuning.peaks import Peaks, find_peaks, hand_over
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.search import AbstractSearch, Found, whole
from qtraj.design.tuning.subproblem import ELASTIC, Step, best_step
from qtraj.design.tuning.task import SLOTS, Present, Task
from qtraj.foundation.types import Flag, Scalar

FIRST_RADIUS, LARGEST_RADIUS, LEAST_RADIUS = 0.5, 2.0, 1e-11
WIDER, NARROWER = 2.5, 0.3  # the next trust radius, in sizes of the step taken or refused
ENOUGH, GOOD = 0.1, 0.7  # parts of what a step promised: with less it is refused, with more the radius may grow
FIRST_PENALTY, PENALTY_GROWTH, HIGHEST_PENALTY = 2.0, 5.0, 1e5
SPARE_PENALTY = 3.0  # times the sum of the multipliers: enough once the limits are met

FEASIBLE = 2e-9
"""Largest relative violation of a limit, as ½((value/limit)² − 1), that counts as met."""

SMALL_STEP = 1e-8
"""A step of this size, in reference speeds and logarithms of time, ends the search."""

LAST_STEP, LEFT = 1e-6, 1e-11
"""A step as good as promised also ends it, if it is smaller than the first of these and its correction leaves no more
than the second of the way to go."""

STATIONARY = 1e-6
"""An imbalance of cost and multipliers below this part of the penalty counts as none."""


class SequentialQuadratic(AbstractSearch):
    """The search "sqp"; `max_steps` are quadratic steps."""

    stages: ClassVar[tuple[int, ...]] = (5, 8, 12, 18, 28, 48, 80)
    max_steps: Int[Array | np.ndarray, ""] = eqx.field(converter=whole)

    @property
    def most_steps(self) -> Int[Array | np.ndarray, ""]:
        return self.max_steps

    def unstarted(self, tasks: Task, z: Any) -> "State":
        return unstarted(tasks.low, tasks.high, tasks.weight, z)

    def proceed(self, tasks: Task, which: Present, states: "State", most_steps: Int[Array | np.ndarray, ""]) -> "State":
        return proceed(tasks, which, states, most_steps)

    def ended(self, tasks: Task, states: "State", xp: Any) -> tuple[Found, Any]:
        peaks = states.peaks
        violation = xp.maximum(xp.max(peaks.value, axis=(-2, -1)), 0.0)
        steps = xp.maximum(states.steps, 0)
        found = Found(states.z, states.multipliers, peaks.time, peaks.value, violation, states.settled, steps)
        return found, states.cost


class State(NamedTuple):
    """Where the searches stand, and the step that each tries next."""

    z: Variables
    cost: Scalar
    peaks: Peaks
    multipliers: Float[Array, "slots k"]
    radius: Scalar
    penalty: Scalar
    lowered: Flag  # the penalty has been lowered
    kept: Flag  # and raised again, so that it stays
    steps: Int[Array, ""]
    done: Flag
    settled: Flag  # done at a stationary point
    effort: Int[Array, ""]  # of the last step's programs

    @property
    def violation(self) -> Scalar:
        """The largest violation, or zero where every limit is met."""
        return jnp.maximum(jnp.max(self.peaks.value, axis=(-2, -1)), 0.0)


class _Verdict(NamedTuple):
    """What a step brought: whether it is taken, whether as good as promised, whether there was nothing to win."""

    taken: Flag
    good: Flag
    flat: Flag


def unstarted(low: Any, high: Any, weight: Any, z: Any) -> State:
    """Searches (a batch in front) before their first look at where they are; in NumPy arrays for NumPy arrays."""
    xp: Any = np if isinstance(z, np.ndarray) else jnp
    batch = z.shape[:1]
    no, none = xp.zeros(batch, bool), xp.zeros(batch, np.int32)
    peaks = jax.tree.map(lambda x: xp.broadcast_to(xp.asarray(x), (*batch, *x.shape)), peaking.none(z.dtype))
    return State(
        z=xp.clip(z, low, high),
        cost=xp.zeros(batch, z.dtype),
        peaks=peaks,
        multipliers=xp.zeros(peaks.time.shape, z.dtype),
        radius=xp.full(batch, FIRST_RADIUS, z.dtype),
        penalty=xp.where(weight > 0, FIRST_PENALTY, 1.0).astype(z.dtype),
        lowered=no,
        kept=no,
        steps=none - 1,
        done=no,
        settled=no,
        effort=none,
    )


def proceed(tasks: Task, which: Present, states: State, most_steps: Int[Array | np.ndarray, ""]) -> State:
    """Steps of searches side by side (a batch in front) until each is done or has taken `most_steps`."""

    def going(s: State) -> Bool[Array, " batch"]:
        return ~s.done & (s.steps < most_steps)

    def onward(s: State) -> State:
        on = going(s)
        # All searches of a block begin at once: then there is no step to work out.
        found, times = jax.lax.cond(jnp.all(s.steps < 0), lambda: _nowhere(s), lambda: jax.vmap(move)(tasks, s))
        after = jax.vmap(arrive)(tasks, s, found, times)
        return jax.tree.map(lambda new, old: jnp.where(jnp.expand_dims(on, range(1, new.ndim)), new, old), after, s)

    def move(task: Task, s: State) -> tuple[Step, Array]:
        model = models.build(task, which, s.z, s.peaks)
        found = best_step(task, which, s.z, model, s.multipliers, s.penalty, s.radius)
        return found, model.constraints.time

    def arrive(task: Task, s: State, found: Step, times: Array) -> State:
        there = _at(task, which, s, found, times)
        ended = _next(task, s, there, found, _judged(task, s, there, found), times)
        begun = there._replace(multipliers=s.multipliers, steps=s.steps + 1)
        return jax.tree.map(lambda a, b: jnp.where(s.steps < 0, a, b), begun, ended)

    return jax.lax.while_loop(lambda s: jnp.any(going(s)), onward, states)


def _nowhere(s: State) -> tuple[Step, Array]:
    """No step, of many searches, and the times of its constraints."""
    none, rows = jnp.zeros_like(s.cost), jnp.zeros((*s.cost.shape, SLOTS, models.ROWS), s.z.dtype)
    return Step(jnp.zeros_like(s.z), rows, none, none, jnp.zeros_like(s.done), none, none, s.effort), rows


def _next(task: Task, s: State, there: State, found: Step, verdict: _Verdict, times: Array) -> State:
    """The state after a step was judged."""
    taken = verdict.taken
    ended: State = jax.tree.map(lambda a, b: jnp.where(taken, a, b), there, s)
    # At a flat end, where the step itself may be refused, what the program last said holds for the place as it is.
    flat = verdict.flat & ~taken
    handed = hand_over(found.multipliers, times, s.peaks)
    ended = ended._replace(multipliers=jnp.where(flat, handed, ended.multipliers))
    still = (taken & _arrives(s, found, verdict)) | verdict.flat
    ended = _with_penalty(task, ended, found, taken, still)
    hopeless = (task.weight == 0) | (s.penalty >= HIGHEST_PENALTY)
    settled = still & ((ended.violation <= FEASIBLE) | hopeless)
    radius = _radius(s, found, verdict)
    done = settled | ~(radius >= LEAST_RADIUS)  # or NaN: nothing leads on from there
    return ended._replace(radius=radius, steps=s.steps + 1, done=done, settled=settled, effort=found.effort)


def _at(task: Task, which: Present, s: State, found: Step, times: Array) -> State:
    """The state after the step, if it is taken."""
    z = s.z + found.d
    peaks = find_peaks(models.setting(task.problem, z), which, task.limits)
    multipliers = hand_over(found.multipliers, times, peaks)
    return s._replace(z=z, cost=task.problem.cost(z), peaks=peaks, multipliers=multipliers)


def _judged(task: Task, s: State, there: State, found: Step) -> _Verdict:
    before = task.weight * s.cost + s.penalty * s.violation
    gained = before - task.weight * there.cost - s.penalty * there.violation
    rounding = 10 * jnp.finfo(before.dtype).eps * (jnp.abs(before) + s.penalty)
    flat = found.solved & (found.promise <= rounding) & (found.residual < STATIONARY)
    enough, good = (gained >= part * found.promise - rounding for part in (ENOUGH, GOOD))
    # A program solved badly may still lead downhill, but only one solved well can tell that this is the end.
    return _Verdict(enough & ((found.promise > rounding) | flat), good, flat)


def _arrives(s: State, found: Step, verdict: _Verdict) -> Flag:
    """Whether a step that is taken leads to where nothing is left to do."""
    size = jnp.max(jnp.abs(found.d))
    last = found.solved & verdict.good & (size < jnp.minimum(LAST_STEP, 0.5 * s.radius)) & (found.left < LEFT)
    return (size < SMALL_STEP) | last


def _radius(s: State, found: Step, verdict: _Verdict) -> Scalar:
    """The next trust radius: wider after a step as good as promised, narrower after one refused."""
    size = jnp.max(jnp.abs(found.d))
    wide = jnp.maximum(s.radius, jnp.minimum(WIDER * size, LARGEST_RADIUS))
    narrow = NARROWER * jnp.clip(size, 0.1 * s.radius, s.radius)
    return jnp.where(verdict.taken, jnp.where(verdict.good, wide, s.radius), narrow)


def _with_penalty(task: Task, s: State, found: Step, taken: Flag, still: Flag) -> State:
    """The state with its next penalty.

    Larger where it holds the step back from the limits. Where they are met, no larger than the multipliers need, or
    steps along a curved limit would have to be short; but one that had to be raised again is not lowered any more.
    """
    total = jnp.sum(found.multipliers)
    inside = jnp.max(jnp.abs(found.d)) < 0.5 * s.radius  # or the radius, not the penalty, holds it back
    pressed = taken & inside & (found.allowed > 0.1 * FEASIBLE) & (total > 0.5 * s.penalty)
    met = s.violation <= FEASIBLE
    raised = (pressed | (still & ~met)) & (task.weight > 0)
    penalty = jnp.where(raised, jnp.minimum(PENALTY_GROWTH * s.penalty, HIGHEST_PENALTY), s.penalty)
    lower = jnp.minimum(jnp.maximum(SPARE_PENALTY * total, _first_penalty(task)), penalty)
    penalty = jnp.where(taken & met & ~s.kept, lower, penalty)
    # Where limits cannot be met yet, the multipliers are those of the penalty, and grow with it.
    growth = jnp.where(~met & (total > ELASTIC * s.penalty), penalty / s.penalty, 1.0)
    return s._replace(
        penalty=penalty,
        multipliers=s.multipliers * growth,
        lowered=s.lowered | (penalty < s.penalty),
        kept=s.kept | (s.lowered & (penalty > s.penalty)),
    )


def _first_penalty(task: Task) -> Scalar:
    return jnp.where(task.weight > 0, FIRST_PENALTY, 1.0).astype(task.weight.dtype)
