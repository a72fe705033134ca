"""Sequential quadratic programming (SQP) on refined peaks, for batches of small, smooth tuning problems.

The search minimises the merit function weight·cost + ν·max(0, max g) over a box, where max g is the largest constraint
value and ν is the penalty. The penalty is exact, and applies to the largest violation rather than to the sum, because
the largest violation is continuous when peaks appear or vanish. With weight 0, the search minimises max g.

Each step solves a convex quadratic program (QP) in the step d and the allowed violation t, within a trust radius. The
Hessian of the QP is the exact Hessian of the Lagrangian, including the motion of the peaks. If this Hessian is not
positive definite, squares of the active constraints are added, and finally negative eigenvalues change sign. If a step
reduces the merit function by less than a tenth of the predicted decrease, a second QP corrects it with the constraint
values after the step. If this fails, too, the trust radius is reduced. Finished searches make room for others.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.model import Model, build, costs, replaced, side_by_side
from qtraj.design.tuning.peaks import Peaks, find_peaks, joined, peaks_of, renumbered, without
from qtraj.design.tuning.search import AbstractSearch, Callback, Ends, Penalty
from qtraj.design.tuning.searches import Curves, Searches
from qtraj.design.tuning.sqp_state import State
from qtraj.design.tuning.subproblem import PENALISED, Step, compute_step, corresponding, transferred

INITIAL_RADIUS, MAX_RADIUS, MIN_RADIUS = 0.5, 2.0, 1e-11
GROWTH, SHRINKAGE = 2.5, 0.3  # next trust radius divided by the size of a good or a rejected step
MIN_RATIO, GOOD_RATIO = 0.1, 0.7  # minimum actual/predicted decrease to accept a step, and to increase the radius
INITIAL_PENALTY, PENALTY_GROWTH, MAX_PENALTY = 2.0, 5.0, 1e5
FLOOR_GROWTH = 25.0  # of the lower limit of the penalty
LARGE_PENALTY = 10.0
"""The lower limit of a `LARGE` penalty, and its initial value divided by 1 + |cost|."""

PENALTY_MARGIN = 3.0  # penalty divided by the sum of the multipliers, if the limits are satisfied

BLOCK = 1024
"""Number of searches that run together; with more of them, their arrays do not fit the processor's cache."""

FEASIBLE = 2e-9
"""Tolerance on the constraint value ln(value/limit), up to which a limit counts as satisfied."""

ENOUGH = -0.02
"""The constraint value at which a search that minimises only the largest constraint value ends."""

SMALL_STEP = 1e-8
"""The search ends if the largest component of a step in the variables z is below this value."""

SMALL_GOOD_STEP, MAX_REMAINING = 1e-5, 1e-11
"""A good step also ends the search if its size is below the first value, and the estimated distance from the solution
is below the second value."""

NEGLIGIBLE, SLOW = 1e-11, 0.3
"""A step also ends the search if its predicted decrease relative to the merit function is below the first value, and
its size divided by the size of the last step is above the second: peaks that merge at the solution make steps slow."""

BALANCED = 1e-3
"""Small steps end a search only if the gradient of the Lagrangian, relative to the penalty, is below this value: where
a narrow peak has an enormous second derivative, a step is small although the point is not stationary."""

PROGRESS, LEAST_PROGRESS, PATIENCE = 1e-4, 0.01, 60
"""A search without progress in the last number of steps ends without convergence. Progress is a step of at least the
first size; while limits are violated, it is a decrease of the largest constraint value by at least the second part."""

STATIONARY = 1e-6
"""Tolerance on the same gradient, if the predicted decrease is within the rounding error."""


class SequentialQuadratic(AbstractSearch):
    """The search method "sqp"; `max_steps` is the maximum number of SQP steps."""

    max_steps: int

    @property
    def total_steps(self) -> int:
        """The maximum number of steps of one search."""
        return self.max_steps

    def search(
        self,
        searches: Searches,
        z: Float[np.ndarray, "n batch"],
        callback: Callback | None = None,
        penalty: Penalty = Penalty.USUAL,
    ) -> Ends:
        """Return the final points of a batch of searches, each from its own `z`."""
        end = run(searches, z, self.max_steps, callback, penalty)
        return Ends(end.z, end.cost, end.largest, end.stationary, end.steps, np.ones(searches.count))


class _Trial(NamedTuple):
    """A step and the point after it; `accepted`, `good` and `converged` assess the step.

    `good` means that the decrease of the merit function is close to the predicted decrease, and `converged` that the
    predicted decrease is within the rounding error and the gradient of the Lagrangian is small.
    """

    step: Step
    z: np.ndarray
    cost: np.ndarray
    largest: np.ndarray
    peaks: Peaks
    accepted: np.ndarray
    good: np.ndarray
    converged: np.ndarray


def run(
    searches: Searches,
    z: Float[np.ndarray, "n batch"],
    max_steps: int,
    callback: Callback | None = None,
    penalty: Penalty = Penalty.USUAL,
) -> State:
    """Return the final states of a batch of searches, each from its own `z`.

    `callback` is called with the number of finished searches.
    """
    with np.errstate(all="ignore"):
        return _run(searches, np.clip(z, searches.low, searches.high), max_steps, callback, penalty)


def _run(searches: Searches, z: np.ndarray, max_steps: int, callback: Callback | None, penalty: Penalty) -> State:
    count, entered = searches.count, 0
    final = _first(searches, z, np.zeros(count), np.zeros(count))
    index, active, state, model, multipliers = np.arange(0), searches, final, None, np.zeros((0, 0))
    while True:
        if index.size <= BLOCK // 2 and entered < count:
            new = np.arange(entered, min(entered + BLOCK - index.size, count))
            entered += new.size
            own_state, own_model = _entered(searches.take(new), z[:, new], penalty)
            if model is not None and index.size:
                state = State(*(np.concatenate(x, axis=-1) for x in zip(state.fields, own_state.fields, strict=True)))
                empty = np.zeros(own_model.value.shape)
                model, multipliers = side_by_side(model, multipliers, own_model, empty)
            else:
                state, model, multipliers = own_state, own_model, np.zeros(own_model.value.shape)
            index = np.concatenate([index, new])
            active = searches.take(index)
        state, model, multipliers = _advance(active, state, model, multipliers)  # type: ignore[arg-type]
        final.put(index, state)
        on = ~state.done & (state.steps < max_steps)
        if on.all():
            continue
        if callback is not None:
            callback(int(final.done.sum()))
        index = index[on]
        if index.size == 0 and entered == count:
            return final
        active, state, model, multipliers = active.take(on), state.take(on), model.take(on), multipliers[:, on]


def _entered(searches: Searches, z: np.ndarray, penalty: Penalty) -> tuple[State, Model]:
    """Return the states and the models of new searches."""
    peaks, largest = find_peaks(searches, Curves(searches, z))
    state = _first(searches, z, costs(searches, z), largest)
    if penalty is not Penalty.USUAL:
        state.penalty = LARGE_PENALTY * (1 + np.abs(state.cost))
        state.floor = np.full(searches.count, LARGE_PENALTY) if penalty is Penalty.LARGE else state.penalty
    return state, build(searches, z, peaks)


def _first(searches: Searches, z: np.ndarray, cost: np.ndarray, largest: np.ndarray) -> State:
    count = searches.count
    no = np.zeros(count, bool)
    return State(
        z=z.copy(),
        cost=np.array(cost),
        largest=largest.copy(),
        radius=np.full(count, INITIAL_RADIUS),
        penalty=np.where(searches.weight > 0, INITIAL_PENALTY, 1.0),
        size=np.ones(count),
        rejected=no.copy(),
        floor=np.where(searches.weight > 0, INITIAL_PENALTY, 1.0),
        lowered=no.copy(),
        least=np.full(count, np.inf),
        stalled=np.zeros(count, int),
        steps=np.zeros(count, int),
        done=no.copy(),
        stationary=no.copy(),
    )


def _advance(searches: Searches, s: State, model: Model, multipliers: np.ndarray) -> tuple[State, Model, np.ndarray]:
    """Return the states, models and multipliers of all searches after one step."""
    step = compute_step(searches, s.z, model, multipliers, s.penalty, s.radius, s.size, ~s.rejected)
    trial = _try(searches, s, step)
    failed = np.flatnonzero(~trial.accepted & ~trial.converged)
    state, here, there = _next(searches, s, trial), model, multipliers
    moved = trial.accepted.copy()
    peaks = trial.peaks
    if failed.size:
        few, own, old = searches.take(failed), s.take(failed), model.take(failed)
        at = corresponding(few, old, peaks_of(trial.peaks, failed, s.done.size))
        shifted = at - np.einsum("kib,ib->kb", old.slopes, step.d[:, failed])
        second = compute_step(
            few, own.z, old, multipliers[:, failed], own.penalty, own.radius, own.size, ~own.rejected, shifted
        )
        predicted = step.predicted_decrease[failed]
        corrected = _try(few, own, second._replace(predicted_decrease=predicted, residual=step.residual[failed]))
        better = corrected.accepted
        if better.any():
            chosen = failed[better]
            state.put(chosen, _next(few, own, corrected).take(better))
            step.multipliers[:, chosen] = second.multipliers[:, better]
            peaks = joined(without(peaks, chosen), renumbered(corrected.peaks, failed, better))
            moved[chosen] = True
    stay = trial.converged & ~moved
    there = np.where(stay, step.multipliers, there)
    going = np.flatnonzero(moved & ~state.done)
    if going.size:
        few = searches if going.size == s.done.size else searches.take(going)
        new = build(few, state.z[:, going], peaks_of(peaks, going, s.done.size))
        carried = transferred(step.multipliers[:, going], model.take(going), new)
        here, there = replaced(here, there, going, new, carried)
    # While the limits cannot be satisfied, the sum of the multipliers equals the penalty and is raised with it.
    sums = step.multipliers.sum(axis=0)
    grows = (state.largest > FEASIBLE) & (sums > PENALISED * s.penalty)
    return state, here, there * np.where(grows, state.penalty / s.penalty, 1.0)


def _try(searches: Searches, s: State, step: Step) -> _Trial:
    z = np.clip(s.z + step.d, searches.low, searches.high)
    peaks, largest = find_peaks(searches, Curves(searches, z))
    cost = costs(searches, z)
    before, after = (_merit(searches, s.penalty, *x) for x in ((s.cost, s.largest), (cost, largest)))
    gained = before - after
    rounding = 10 * np.finfo(float).eps * (np.abs(before) + s.penalty)
    converged = (step.predicted_decrease <= rounding) & (step.residual < STATIONARY)
    # A constant in a user's objective rounds its values but not its derivatives, which then decide.
    error = rounding + searches.problem.noise
    enough, good = (gained >= part * step.predicted_decrease - error for part in (MIN_RATIO, GOOD_RATIO))
    accepted = enough & ((step.predicted_decrease > rounding) | converged)
    return _Trial(step, z, cost, largest, peaks, accepted, good, converged)


def _merit(searches: Searches, penalty: np.ndarray, cost: np.ndarray, largest: np.ndarray) -> np.ndarray:
    floor = np.where(searches.weight > 0, 0.0, ABSENT)
    return searches.weight * cost + penalty * np.maximum(largest, floor)


def _next(searches: Searches, s: State, trial: _Trial) -> State:
    """Return the states after a step was accepted or rejected."""
    step, accepted = trial.step, trial.accepted
    size = np.abs(step.d).max(axis=0)
    remaining = size * np.minimum(size / s.size, 1.0) ** 2
    last = trial.good & (size < np.minimum(SMALL_GOOD_STEP, 0.5 * s.radius)) & (remaining < MAX_REMAINING)
    least = NEGLIGIBLE * np.abs(_merit(searches, s.penalty, s.cost, s.largest))
    slow = (step.predicted_decrease <= least) & (size > SLOW * s.size)
    ends = (accepted & ((size < SMALL_STEP) | last | slow) & (step.residual < BALANCED)) | trial.converged
    z = np.where(accepted, trial.z, s.z)
    cost, largest = np.where(accepted, trial.cost, s.cost), np.where(accepted, trial.largest, s.largest)
    wide = np.maximum(s.radius, np.minimum(GROWTH * size, MAX_RADIUS))
    narrow = SHRINKAGE * np.clip(size, 0.1 * s.radius, s.radius)
    radius = np.where(accepted, np.where(trial.good, wide, s.radius), narrow)
    penalty, floor, lowered = _penalty(searches, s, step, accepted, ends, largest)
    hopeless = (searches.weight == 0) | (s.penalty >= MAX_PENALTY)
    stationary = ends & ((largest <= FEASIBLE) | hopeless)
    enough = (searches.weight == 0) & (largest <= ENOUGH)
    size = np.where(accepted, size, s.size)
    least, stalled = _progress(s, largest, size)
    done = stationary | enough | (stalled >= PATIENCE) | ~(radius >= MIN_RADIUS)  # NaN also ends the search
    steps = s.steps + 1
    return State(
        z, cost, largest, radius, penalty, size, ~accepted, floor, lowered, least, stalled, steps, done, stationary
    )


def _progress(s: State, largest: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the next `least` and `stalled` of the state."""
    met = largest <= FEASIBLE
    progress = np.where(met, size >= PROGRESS, largest < (1 - LEAST_PROGRESS) * s.least)
    least = np.where(met, np.inf, np.minimum(s.least, largest))
    return least, np.where(progress, 0, s.stalled + 1)


def _penalty(
    searches: Searches, s: State, step: Step, accepted: np.ndarray, ends: np.ndarray, largest: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the next penalty, its lower limit, and whether it was lowered more recently than raised.

    The penalty is raised if it is too small for a step to satisfy the limits. If the limits are satisfied, the penalty
    is lowered to a multiple of the sum of the multipliers, because a larger penalty would force short steps along a
    curved constraint. If the penalty must then be raised again, its lower limit is raised, too.
    """
    total = step.multipliers.sum(axis=0)
    inside = np.abs(step.d).max(axis=0) < 0.5 * s.radius  # otherwise the radius limits the step
    active = accepted & inside & (step.allowed_violation > 0.1 * FEASIBLE) & (total > 0.5 * s.penalty)
    met = largest <= FEASIBLE
    raised = (active | (ends & ~met)) & (searches.weight > 0)
    floor = np.where(raised & s.lowered, np.minimum(FLOOR_GROWTH * s.floor, MAX_PENALTY), s.floor)
    penalty = np.where(raised, np.minimum(PENALTY_GROWTH * s.penalty, MAX_PENALTY), s.penalty)
    penalty = np.where(accepted & met, np.minimum(np.maximum(PENALTY_MARGIN * total, floor), penalty), penalty)
    return penalty, floor, np.where(raised, False, s.lowered | (penalty < s.penalty))
