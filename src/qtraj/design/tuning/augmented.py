"""The augmented Lagrangian method, with any optax optimiser for the inner problem.

An outer iteration (a round) minimises the augmented Lagrangian (see `lagrangian`) with the optimiser, and selects the
best of the evaluated points. The next round depends on the accuracy of the best point:

- If the point is accurate (its gradient is small, or the optimiser no longer moves), the multipliers m become max(0, m
  + μg), where g are the constraint values. The penalty μ grows if the violation did not decrease enough.
- If the point is inaccurate but the last steps still improved it, the next round keeps m, μ and the stride.
- If the point is inaccurate and the last steps did not improve it, the steps of the optimiser are too long. The next
  round multiplies all updates by a smaller `stride`, so that an optimiser with a fixed learning rate converges, too.

The times of the peaks are constant during one step of the optimiser, including its line search.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.grid_peaks import GridPeaks, no_peaks
from qtraj.design.tuning.lagrangian import (
    PerInterval,
    Round,
    expand,
    from_box,
    interval_maxima,
    lagrangian,
    make_round,
    to_box,
)
from qtraj.design.tuning.problem import broadcasting
from qtraj.design.tuning.search import AbstractSearch, Callback, Ends
from qtraj.design.tuning.searches import Searches
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task
from qtraj.foundation import cores
from qtraj.foundation.indexing import choose
from qtraj.foundation.types import Flag, Scalar

INITIAL_PENALTY, PENALTY_GROWTH, MAX_PENALTY = 10.0, 4.0, 1e9
SUFFICIENT_DECREASE = 0.25  # the penalty is raised if the ratio of successive residuals exceeds this value
HOPELESS_DECREASE, HOPELESS_ROUNDS = 0.9, 6  # the search fails after 6 successive ratios above 0.9

STATIONARY = 1e-6
"""Largest component of the Lagrangian's gradient at a converged point, in the scaled problem."""

COMPLEMENTARY = 1e-6
"""Tolerance on ln(value/limit) for an active constraint at a converged point."""

MAX_TOLERANCE, MIN_TOLERANCE, TOLERANCE_RATIO = 1e-2, 1e-7, 0.1
"""Bounds on the gradient tolerance at which a round ends, and the ratio of this tolerance to the residual."""

STRIDE_FACTOR, MIN_STRIDE = 0.5, 1e-9  # factor on the stride after a round without improvement, and its lower bound

LATE_FRACTION = 10
"""The optimiser is still improving if the best point is in the last tenth of the steps of a round."""

ROUNDING = 1e-13
"""Values count as equal up to this relative difference; the point with the smaller gradient is then better."""


class Point(NamedTuple):
    """A point y that was evaluated during a round; `value` and `gradient_norm` belong to the augmented Lagrangian."""

    y: Float[Array, " n"]
    value: Scalar
    gradient_norm: Scalar  # magnitude of the largest component of the gradient
    cost: Scalar
    step: Int[Array, ""]  # within the round
    multipliers: PerInterval  # of the next round: max(0, m + μg), with multipliers m, penalty μ and constraint values g
    times: PerInterval
    peaks: GridPeaks


class State(NamedTuple):
    """The state of a batch of searches; `constants` are the constants of the current round."""

    y: Float[Array, " n"]
    memory: Any  # the optimiser's state
    reset: Flag  # the optimiser's state has to be initialised
    stuck: Flag  # the last step did not change y
    best: Point
    constants: Round
    stride: Scalar
    tolerance: Scalar
    residual: Scalar
    hopeless: Int[Array, ""]
    round: Int[Array, ""]
    step: Int[Array, ""]  # within the round; 0 before the first point is evaluated
    steps: Int[Array, ""]
    done: Flag
    stationary: Flag


class AugmentedLagrangian(AbstractSearch):
    """The augmented Lagrangian search with an optax optimiser, compiled by JAX."""

    optimiser: Any = eqx.field(static=True)
    rounds: int
    inner_steps: int

    @property
    def total_steps(self) -> int:
        """The maximum number of steps of one search."""
        return self.rounds * (self.inner_steps + 1)

    def search(
        self,
        searches: Searches,
        z: Float[np.ndarray, "n batch"],
        callback: Callback | None = None,
        satisfying: bool = False,
    ) -> Ends:
        """Return the final points of a batch of searches, each from its own `z`."""
        task = Task(searches.problem, searches.limits, searches.low.T, searches.high.T)
        count = searches.count
        size = cores.block_size(count)
        parts = cores.split(np.arange(count), size)
        limits = np.asarray([self.rounds, self.inner_steps], np.int32)
        calls = [(self.optimiser, limits, cores.take(task, part, size), cores.take(z.T, part, size)) for part in parts]
        found, done = [], 0
        for part, block in zip(parts, cores.map_blocks(_run, calls), strict=True):
            found.append(jax.tree.map(lambda x, part=part: x[: part.size], block))
            done += part.size
            if callback is not None:
                callback(done)
        ends = jax.tree.map(lambda *x: np.concatenate(x), *found)
        return ends._replace(z=np.array(ends.z.T))


@eqx.filter_jit
def _run(optimiser: Any, limits: Int[Array, " 2"], tasks: Task, z: Float[Array, "batch n"]) -> Ends:
    """Run a batch of searches; `limits` are the maximum numbers of rounds, and of steps in a round."""
    with broadcasting():
        rounds, inner_steps = limits[0], limits[1]
        search = _Search(optimiser, rounds, inner_steps)
        tasks = jax.tree.map(jnp.asarray, tasks)
        states = jax.vmap(search.init)(tasks, jnp.clip(jnp.asarray(z), tasks.low, tasks.high))

        def is_running(s: State) -> Bool[Array, " batch"]:
            return ~s.done & (s.steps < rounds * (inner_steps + 1))

        def advance(s: State) -> State:
            on = is_running(s)
            return choose(on, jax.vmap(search.step)(tasks, s, on), s)

        end = jax.lax.while_loop(lambda s: jnp.any(is_running(s)), advance, states)
        largest = jnp.max(end.best.peaks.value, axis=(-2, -1))
        return Ends(
            to_box(tasks, end.best.y),
            end.best.cost,
            largest,
            end.stationary,
            jnp.maximum(end.steps, 0),
            jnp.ones_like(largest),
        )


class _Search(NamedTuple):
    """The search for one problem."""

    optimiser: Any
    rounds: Int[Array, ""]
    inner_steps: Int[Array, ""]

    def init(self, task: Task, z: Float[Array, " n"]) -> State:
        """Return the state before the first evaluation."""
        dtype = z.dtype
        peaks = jax.tree.map(jnp.asarray, no_peaks(len(task.limits), dtype))
        number, no, none = jnp.zeros((), dtype), jnp.zeros((), bool), jnp.zeros((), jnp.int32)
        infinite = number + jnp.inf
        return State(
            y=z,
            memory=jax.tree.map(jnp.zeros_like, self._initial(z)),
            reset=~no,
            stuck=no,
            best=Point(z, infinite, infinite, number, none, peaks.time, peaks.time, peaks),
            constants=Round(peaks.present, peaks.time, peaks.time, peaks.time, number + INITIAL_PENALTY),
            stride=number + 1.0,
            tolerance=number + MAX_TOLERANCE,
            residual=infinite,
            hopeless=none,
            round=none - 1,
            step=none,
            steps=none - 1,
            done=no,
            stationary=no,
        )

    def step(self, task: Task, s: State, on: Flag) -> State:
        """Evaluate the current point. Then take a step of the optimiser, or start the next round."""
        y = jnp.where(s.steps < 0, from_box(task, s.y), s.y)
        times, peaks = interval_maxima(task, s.constants, y)
        at = expand(task, s.constants, times, y)
        gradient_norm = jnp.max(jnp.abs(at.gradient))
        multipliers = jnp.maximum(s.constants.multipliers + s.constants.penalty * at.g, 0.0)
        here = Point(y, at.value, gradient_norm, at.cost, s.step, multipliers, times, peaks)
        better = (s.step == 0) | _better(here, s.best, task.problem.noise)
        best: Point = jax.tree.map(lambda a, b: jnp.where(better, a, b), here, s.best)
        solved = (s.steps >= 0) & (best.gradient_norm <= s.tolerance)
        round_ends = (s.steps < 0) | solved | s.stuck | (s.step >= self.inner_steps) | ~jnp.isfinite(at.value)
        y, memory = self._optimiser_step(task, s, at, times, y, on & ~round_ends)
        stepped = s._replace(
            y=y,
            memory=memory,
            reset=jnp.zeros_like(s.reset),
            stuck=jnp.all(y == here.y),
            best=best,
            step=s.step + 1,
            steps=s.steps + 1,
        )
        next_round = _next_round(s, best, solved, self.rounds)
        return jax.tree.map(lambda a, b: jnp.where(round_ends, a, b), next_round, stepped)

    def _initial(self, y: Array) -> Any:
        with jax.numpy_dtype_promotion("standard"):  # optax mixes dtypes, which strict promotion rejects
            return self.optimiser.init(y)

    def _optimiser_step(
        self, task: Task, s: State, at: Any, times: PerInterval, y: Array, is_active: Flag
    ) -> tuple[Array, Any]:
        """Return the point after a step of the optimiser, and the optimiser's state."""
        # A zero gradient ends the line search at once: inactive searches must not delay the others in the batch.
        gradient = jnp.where(is_active, at.gradient, 0.0)
        with jax.numpy_dtype_promotion("standard"):
            memory = jax.tree.map(lambda a, b: jnp.where(s.reset, a, b), self.optimiser.init(y), s.memory)
            updates, after = self.optimiser.update(
                gradient,
                memory,
                y,
                value=at.value,
                grad=gradient,
                value_fn=lambda y: lagrangian(task, s.constants, times, y)[0],
            )
            after = jax.tree.map(lambda new, old: jnp.asarray(new).astype(old.dtype), after, memory)
        return y + s.stride * updates.astype(y.dtype), after


def _better(here: Point, best: Point, noise: Scalar) -> Flag:
    rounding = ROUNDING * (1 + jnp.abs(best.value)) + noise
    lower = here.value < best.value - rounding
    return lower | ((here.value <= best.value + rounding) & (here.gradient_norm < best.gradient_norm))


def _next_round(s: State, best: Point, solved: Flag, rounds: Int[Array, ""]) -> State:
    """Return the state at the beginning of the next round, which starts from the best point of the last round."""
    constants = s.constants
    residual = jnp.max(jnp.abs(best.multipliers - constants.multipliers)) / constants.penalty
    violation = jnp.max(best.peaks.value)
    stationary = (violation <= FEASIBLE) & (best.gradient_norm <= STATIONARY) & (residual <= COMPLEMENTARY)
    exact = solved | s.stuck
    slow = exact & (residual > SUFFICIENT_DECREASE * s.residual)
    hopeless = jnp.where(exact, jnp.where(residual > HOPELESS_DECREASE * s.residual, s.hopeless + 1, 0), s.hopeless)
    is_improving = LATE_FRACTION * best.step >= (LATE_FRACTION - 1) * s.step
    stride = jnp.where(exact | is_improving, 1.0, STRIDE_FACTOR) * s.stride
    tolerance = jnp.clip(TOLERANCE_RATIO * residual, MIN_TOLERANCE, s.tolerance)
    fails = (hopeless >= HOPELESS_ROUNDS) | (constants.penalty > MAX_PENALTY) | (stride < MIN_STRIDE)
    fails = fails | ~jnp.isfinite(best.value)
    return s._replace(
        y=best.y,
        reset=jnp.ones_like(s.reset),
        stuck=jnp.zeros_like(s.stuck),
        best=best,
        constants=make_round(
            constants._replace(
                multipliers=jnp.where(exact, best.multipliers, constants.multipliers),
                penalty=jnp.where(slow, PENALTY_GROWTH, 1.0) * constants.penalty,
            ),
            best.times,
            best.peaks,
        ),
        stride=stride,
        tolerance=jnp.where(exact, tolerance, s.tolerance),
        residual=jnp.where(exact, residual, s.residual),
        hopeless=hopeless,
        round=s.round + 1,
        step=jnp.zeros_like(s.step),
        steps=s.steps + 1,
        done=stationary | fails | (s.round + 1 >= rounds),
        stationary=stationary,
    )
