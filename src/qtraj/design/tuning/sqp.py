"""Sequential quadratic programming (SQP) on refined peaks, for batches of small, smooth tuning problems.

The search minimises the merit function weight·cost + ν·max(0, max g) over a box, where max g is the largest constraint
value and ν is the penalty. The penalty is exact, and applies to the largest violation rather than to the sum, because
the largest violation is continuous when peaks appear or vanish.

Each step solves a convex quadratic program (QP) in the step d and the allowed violation t, within a trust radius. The
Hessian of the QP is the exact Hessian of the Lagrangian, including the motion of the peaks. If this Hessian is not
positive definite, squares of the active constraints are added. These squares do not change the solution while the
constraints remain active. If the limits cannot be satisfied, all active constraint values equal t, so squares of the
differences between these values are added instead. If the Hessian is still not positive definite, a multiple of the
identity is added. A second QP, about the end point of the first step, corrects the step. If a step reduces the merit
function by less than a tenth of the predicted decrease, it is rejected, and the trust radius is reduced.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning import model as models, peaks as peaking
from qtraj.design.tuning.peaks import Peaks, find_peaks, transfer_multipliers
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.search import AbstractSearch, SearchResult, step_count
from qtraj.design.tuning.subproblem import PENALISED, Step, compute_step
from qtraj.design.tuning.task import LimitSlots, Task
from qtraj.foundation.indexing import choose
from qtraj.foundation.types import Flag, Scalar

INITIAL_RADIUS, MAX_RADIUS, MIN_RADIUS = 0.5, 2.0, 1e-11
GROWTH, SHRINKAGE = 2.5, 0.3  # next trust radius divided by the size of a good or a rejected step
MIN_RATIO, GOOD_RATIO = 0.1, 0.7  # minimum actual/predicted decrease to accept a step, and to increase the radius
INITIAL_PENALTY, PENALTY_GROWTH, MAX_PENALTY = 2.0, 5.0, 1e5
PENALTY_MARGIN = 3.0  # penalty divided by the sum of the multipliers, if the limits are satisfied

FEASIBLE = 2e-9
"""Tolerance on the constraint value ½((value/limit)² − 1), up to which a limit counts as satisfied."""

SMALL_STEP = 1e-8
"""The search ends if the largest component of a step in the variables z is below this value."""

SMALL_GOOD_STEP, MAX_REMAINING = 1e-6, 1e-11
"""A good step also ends the search if its size is below the first value, and the estimated distance from the solution
is below the second value."""

STATIONARY = 1e-6
"""Tolerance on the gradient of the Lagrangian, relative to the penalty."""


class SequentialQuadratic(AbstractSearch):
    """The search method "sqp"; `max_steps` is the maximum number of SQP steps."""

    stages: ClassVar[tuple[int, ...]] = (5, 8, 12, 18, 28, 48, 80)
    max_steps: Int[Array | np.ndarray, ""] = eqx.field(converter=step_count)

    @property
    def step_limit(self) -> Int[Array | np.ndarray, ""]:
        """Maximum number of SQP steps of a search."""
        return self.max_steps

    def init(self, tasks: Task, z: Any) -> "State":
        """Return the initial state of the searches; each starts from its `z`, clipped to the box."""
        return init(tasks, z)

    def run(self, tasks: Task, slots: LimitSlots, states: "State", max_steps: Int[Array | np.ndarray, ""]) -> "State":
        """Perform SQP steps until each search is done or has reached `max_steps` steps."""
        return run(tasks, slots, states, max_steps)

    def result(self, tasks: Task, states: "State", xp: Any) -> tuple[SearchResult, Any]:
        """Return the current points of the searches, and their costs."""
        peaks = states.peaks
        violation = xp.maximum(xp.max(peaks.value, axis=(-2, -1)), 0.0)
        steps = xp.maximum(states.steps, 0)
        result = SearchResult(
            states.z, states.multipliers, peaks.time, peaks.value, violation, states.stationary, steps
        )
        return result, states.cost


class State(NamedTuple):
    """The state of a batch of searches: the current points, and the parameters of the next step."""

    z: Variables
    cost: Scalar
    peaks: Peaks
    multipliers: Float[Array, "slots k"]
    radius: Scalar
    penalty: Scalar
    lowered: Flag  # the penalty has been lowered
    raised_again: Flag  # the penalty was raised after it had been lowered, and must not be lowered again
    steps: Int[Array, ""]
    done: Flag
    stationary: Flag  # done at a stationary point
    effort: Int[Array, ""]  # QP steps of the last SQP step

    @property
    def violation(self) -> Scalar:
        """The largest constraint value, or zero if every limit is satisfied."""
        return jnp.maximum(jnp.max(self.peaks.value, axis=(-2, -1)), 0.0)


class _Verdict(NamedTuple):
    """The assessment of a step.

    `good` means that the decrease of the merit function is close to the predicted decrease, and `converged` that the
    predicted decrease is within the rounding error and the gradient of the Lagrangian is small.
    """

    accepted: Flag
    good: Flag
    converged: Flag


def init(tasks: Task, z: Any) -> State:
    """Return the state of a batch of searches before the first evaluation; NumPy arrays if `z` is a NumPy array."""
    xp: Any = np if isinstance(z, np.ndarray) else jnp
    batch = z.shape[:1]
    no, none = xp.zeros(batch, bool), xp.zeros(batch, np.int32)
    peaks = jax.tree.map(
        lambda x: xp.broadcast_to(xp.asarray(x), (*batch, *x.shape)), peaking.no_peaks(tasks.limits.shape[-1], z.dtype)
    )
    return State(
        z=xp.clip(z, tasks.low, tasks.high),
        cost=xp.zeros(batch, z.dtype),
        peaks=peaks,
        multipliers=xp.zeros(peaks.time.shape, z.dtype),
        radius=xp.full(batch, INITIAL_RADIUS, z.dtype),
        penalty=xp.where(tasks.weight > 0, INITIAL_PENALTY, 1.0).astype(z.dtype),
        lowered=no,
        raised_again=no,
        steps=none - 1,
        done=no,
        stationary=no,
        effort=none,
    )


def run(tasks: Task, slots: LimitSlots, states: State, max_steps: Int[Array | np.ndarray, ""]) -> State:
    """Perform steps of a batch of searches until each is done or has reached `max_steps` steps."""

    def is_running(s: State) -> Bool[Array, " batch"]:
        return ~s.done & (s.steps < max_steps)

    def advance(s: State) -> State:
        on = is_running(s)
        # All searches of a block start together. The first iteration only evaluates the start, so it needs no QP.
        step, times = jax.lax.cond(jnp.all(s.steps < 0), lambda: _zero_step(s), lambda: move(s))
        z = s.z + step.d
        peaks = find_peaks(jax.vmap(models.make_setting)(tasks.problem, z), slots, tasks.limits)
        after = jax.vmap(_arrive)(tasks, s, step, times, z, peaks)
        return choose(on, after, s)

    def move(s: State) -> tuple[Step, Array]:
        model = models.build(tasks, slots, s.z, s.peaks)
        step = compute_step(tasks, slots, s.z, model, s.multipliers, s.penalty, s.radius)
        return step, model.constraints.time

    return jax.lax.while_loop(lambda s: jnp.any(is_running(s)), advance, states)


def _zero_step(s: State) -> tuple[Step, Array]:
    """Return zero steps for a batch of searches, and zero times of their constraints."""
    none, nothing = jnp.zeros_like(s.cost), jnp.zeros((*s.multipliers.shape[:-1], models.PER_LIMIT), s.z.dtype)
    return Step(jnp.zeros_like(s.z), nothing, none, none, jnp.zeros_like(s.done), none, none, s.effort), nothing


def _arrive(task: Task, s: State, step: Step, times: Array, z: Variables, peaks: Peaks) -> State:
    """Return the state of one search after the step to `z`, or after the evaluation of its start."""
    multipliers = transfer_multipliers(step.multipliers, times, peaks)
    there = s._replace(z=z, cost=task.problem.cost(z), peaks=peaks, multipliers=multipliers)
    after = _next_state(task, s, there, step, _judge(task, s, there, step), times)
    begun = there._replace(multipliers=s.multipliers, steps=s.steps + 1)
    return jax.tree.map(lambda a, b: jnp.where(s.steps < 0, a, b), begun, after)


def _next_state(task: Task, s: State, there: State, step: Step, verdict: _Verdict, times: Array) -> State:
    """Return the state after a step was accepted or rejected."""
    accepted = verdict.accepted
    after: State = jax.tree.map(lambda a, b: jnp.where(accepted, a, b), there, s)
    # The last step of a converged search may be rejected. The multipliers of the QP then belong to the current point.
    converged = verdict.converged & ~accepted
    transferred = transfer_multipliers(step.multipliers, times, s.peaks)
    after = after._replace(multipliers=jnp.where(converged, transferred, after.multipliers))
    ends = (accepted & _is_last(s, step, verdict)) | verdict.converged
    after = _update_penalty(task, after, step, accepted, ends)
    hopeless = (task.weight == 0) | (s.penalty >= MAX_PENALTY)
    stationary = ends & ((after.violation <= FEASIBLE) | hopeless)
    radius = _next_radius(s, step, verdict)
    done = stationary | ~(radius >= MIN_RADIUS)  # NaN also ends the search
    return after._replace(radius=radius, steps=s.steps + 1, done=done, stationary=stationary, effort=step.effort)


def _judge(task: Task, s: State, there: State, step: Step) -> _Verdict:
    before = task.weight * s.cost + s.penalty * s.violation
    gained = before - task.weight * there.cost - s.penalty * there.violation
    rounding = 10 * jnp.finfo(before.dtype).eps * (jnp.abs(before) + s.penalty)
    converged = step.solved & (step.predicted_decrease <= rounding) & (step.residual < STATIONARY)
    enough, good = (gained >= part * step.predicted_decrease - rounding for part in (MIN_RATIO, GOOD_RATIO))
    # The step of an inaccurate QP solution may still be a descent step, but it does not indicate convergence.
    return _Verdict(enough & ((step.predicted_decrease > rounding) | converged), good, converged)


def _is_last(s: State, step: Step, verdict: _Verdict) -> Flag:
    """Check whether an accepted step ends the search."""
    size = jnp.max(jnp.abs(step.d))
    last = (
        step.solved
        & verdict.good
        & (size < jnp.minimum(SMALL_GOOD_STEP, 0.5 * s.radius))
        & (step.remaining < MAX_REMAINING)
    )
    return (size < SMALL_STEP) | last


def _next_radius(s: State, step: Step, verdict: _Verdict) -> Scalar:
    """Return the next trust radius, which is larger after a good step and smaller after a rejected step."""
    size = jnp.max(jnp.abs(step.d))
    wide = jnp.maximum(s.radius, jnp.minimum(GROWTH * size, MAX_RADIUS))
    narrow = SHRINKAGE * jnp.clip(size, 0.1 * s.radius, s.radius)
    return jnp.where(verdict.accepted, jnp.where(verdict.good, wide, s.radius), narrow)


def _update_penalty(task: Task, s: State, step: Step, accepted: Flag, ends: Flag) -> State:
    """Return the state with the next penalty.

    The penalty is raised if it is too small for a step to satisfy the limits. If the limits are satisfied, the penalty
    is lowered to a multiple of the sum of the multipliers, because a larger penalty would force short steps along a
    curved constraint. If the penalty must then be raised again, it is not lowered a second time.
    """
    multiplier_sum = jnp.sum(step.multipliers)
    inside = jnp.max(jnp.abs(step.d)) < 0.5 * s.radius  # otherwise the radius limits the step
    penalty_active = accepted & inside & (step.allowed_violation > 0.1 * FEASIBLE) & (multiplier_sum > 0.5 * s.penalty)
    met = s.violation <= FEASIBLE
    raised = (penalty_active | (ends & ~met)) & (task.weight > 0)
    penalty = jnp.where(raised, jnp.minimum(PENALTY_GROWTH * s.penalty, MAX_PENALTY), s.penalty)
    lower = jnp.minimum(jnp.maximum(PENALTY_MARGIN * multiplier_sum, _initial_penalty(task)), penalty)
    penalty = jnp.where(accepted & met & ~s.raised_again, lower, penalty)
    # While the limits cannot be satisfied, the sum of the multipliers equals the penalty and is raised with it.
    growth = jnp.where(~met & (multiplier_sum > PENALISED * s.penalty), penalty / s.penalty, 1.0)
    return s._replace(
        penalty=penalty,
        multipliers=s.multipliers * growth,
        lowered=s.lowered | (penalty < s.penalty),
        raised_again=s.raised_again | (s.lowered & (penalty > s.penalty)),
    )


def _initial_penalty(task: Task) -> Scalar:
    return jnp.where(task.weight > 0, INITIAL_PENALTY, 1.0).astype(task.weight.dtype)
