"""The augmented Lagrangian method around any optimiser of optax.

A round minimises the augmented Lagrangian (see `lagrangian`) by steps of the optimiser, and ends at the best point it
has seen. What follows depends on how exact that point is:

- Exact enough: the multipliers move to m + μg, and where the constraints came too little nearer the penalty μ grows.
- Not exact, and the last steps brought nothing: the optimiser's steps are too long. The next round takes shorter ones,
  by the factor `stride` on all updates. So an optimiser with a fixed learning rate converges, too.

The times of the peaks stand still during one step, with its line search, if it has one.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from qtraj.design.tuning import peaks as peaking
from qtraj.design.tuning.lagrangian import (
    Held,
    OfParts,
    expand,
    inside,
    lagrangian,
    outside,
    parts,
    worst_times,
)
from qtraj.design.tuning.peaks import Peaks
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.search import AbstractSearch, Found, whole
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation.types import Flag, Scalar

FIRST_PENALTY, PENALTY_GROWTH, HIGHEST_PENALTY = 10.0, 4.0, 1e9
SUFFICIENT_DECREASE = 0.25  # of the residual in one round; less, and the penalty grows
HOPELESS_DECREASE, HOPELESS_ROUNDS = 0.9, 6  # this little decrease for so many rounds, and the search gives up

STATIONARY = 1e-6
"""Largest component of the Lagrangian's gradient at a converged point, in the problem's own scale."""

COMPLEMENTARY = 1e-6
"""How far an active constraint may lie inside its limit at a converged point, as ½((value/limit)² − 1)."""

LOOSEST, FINEST, OF_RESIDUAL = 1e-2, 1e-7, 0.1
"""Gradients at which a round ends: a part of the last residual, between these."""

SHORTER, SHORTEST = 0.5, 1e-9  # the next stride after a round that brought nothing, and the last one

LAST_PART = 10
"""A best point in the last part of so many of a round says that the steps still lead somewhere."""

ROUNDING = 1e-13
"""Values nearer than this part of theirs are equal; the smaller gradient is the better then."""


class Point(NamedTuple):
    """A point that a round has seen."""

    y: Variables
    value: Scalar
    size: Scalar  # of the largest component of the gradient
    cost: Scalar
    step: Int[Array, ""]  # of the round
    force: OfParts  # max(0, m + μg), the next multipliers
    times: OfParts
    peaks: Peaks


class State(NamedTuple):
    """Where the searches stand: in a round, which began with what is held, and before."""

    y: Variables
    memory: Any  # of the optimiser
    fresh: Flag  # the optimiser has to begin anew
    stuck: Flag  # the last step led nowhere
    best: Point
    held: Held
    stride: Scalar
    tolerance: Scalar
    residual: Scalar
    hopeless: Int[Array, ""]
    round: Int[Array, ""]
    step: Int[Array, ""]  # of the round; 0 where no point is known
    steps: Int[Array, ""]
    done: Flag
    settled: Flag
    effort: Int[Array, ""]


class AugmentedLagrangian(AbstractSearch):
    """Rounds of an optax optimiser; see the module. `most_steps` are those of the optimiser, in all rounds."""

    stages: ClassVar[tuple[int, ...]] = (100, 200, 400, 800, 1600, 3200, 6400)
    optimiser: Any = eqx.field(static=True)
    rounds: Int[Array | np.ndarray, ""] = eqx.field(converter=whole)
    inner_steps: Int[Array | np.ndarray, ""] = eqx.field(converter=whole)

    @property
    def most_steps(self) -> Int[Array | np.ndarray, ""]:
        return self.rounds * (self.inner_steps + 1)

    def unstarted(self, tasks: Task, z: Any) -> State:
        xp: Any = np if isinstance(z, np.ndarray) else jnp
        batch, dtype = z.shape[:1], z.dtype
        one = jax.eval_shape(self.optimiser.init, jax.ShapeDtypeStruct(z.shape[1:], dtype))
        memory = jax.tree.map(lambda x: xp.zeros((*batch, *x.shape), x.dtype), one)
        peaks = jax.tree.map(lambda x: xp.broadcast_to(xp.asarray(x), (*batch, *x.shape)), peaking.none(dtype))
        number, no, none = xp.zeros(batch, dtype), xp.zeros(batch, bool), xp.zeros(batch, np.int32)
        unknown = xp.full(batch, np.inf, dtype)
        z = xp.clip(z, tasks.low, tasks.high)
        return State(
            y=z,
            memory=memory,
            fresh=~no,
            stuck=no,
            best=Point(z, unknown, unknown, number, none, peaks.time, peaks.time, peaks),
            held=Held(peaks.present, peaks.time, peaks.time, peaks.time, number + FIRST_PENALTY),
            stride=number + 1.0,
            tolerance=number + LOOSEST,
            residual=unknown,
            hopeless=none,
            round=none - 1,
            step=none,
            steps=none - 1,
            done=no,
            settled=no,
            effort=none,
        )

    def proceed(self, tasks: Task, which: Present, states: State, most_steps: Int[Array | np.ndarray, ""]) -> State:
        def going(s: State) -> Bool[Array, " batch"]:
            return ~s.done & (s.steps < most_steps)

        def onward(s: State) -> State:
            on = going(s)
            after = jax.vmap(lambda task, s, on: self._step(task, which, s, on))(tasks, s, on)
            return jax.tree.map(lambda new, old: jnp.where(jnp.expand_dims(on, range(1, new.ndim)), new, old), after, s)

        return jax.lax.while_loop(lambda s: jnp.any(going(s)), onward, states)

    def ended(self, tasks: Task, states: State, xp: Any) -> tuple[Found, Any]:
        best = states.best
        z = inside(tasks, best.y, xp)
        violation = xp.maximum(xp.max(best.peaks.value, axis=(-2, -1)), 0.0)
        steps = xp.maximum(states.steps, 0)
        return Found(
            z, states.held.multipliers, best.peaks.time, best.peaks.value, violation, states.settled, steps
        ), best.cost

    def _step(self, task: Task, which: Present, s: State, on: Flag) -> State:
        """One look at where a search stands; then the next step of the optimiser, or the next round."""
        y = jnp.where(s.steps < 0, outside(task, s.y), s.y)
        times, peaks = worst_times(task, which, s.held, y)
        at = expand(task, which, s.held, times, y)
        size = jnp.max(jnp.abs(at.gradient))
        force = jnp.maximum(s.held.multipliers + s.held.penalty * at.g, 0.0)
        here = Point(y, at.value, size, at.cost, s.step, force, times, peaks)
        better = (s.step == 0) | _better(here, s.best)
        best: Point = jax.tree.map(lambda a, b: jnp.where(better, a, b), here, s.best)
        solved = (s.steps >= 0) & (best.size <= s.tolerance)
        over = (s.steps < 0) | solved | s.stuck | (s.step >= self.inner_steps) | ~jnp.isfinite(at.value)
        y, memory = self._moved(task, which, s, at, times, y, on & ~over)
        stepped = s._replace(
            y=y,
            memory=memory,
            fresh=jnp.zeros_like(s.fresh),
            stuck=jnp.all(y == here.y),
            best=best,
            step=s.step + 1,
            steps=s.steps + 1,
        )
        begun = _next_round(s, best, solved, self.rounds)
        return jax.tree.map(lambda a, b: jnp.where(over, a, b), begun, stepped)

    def _moved(
        self, task: Task, which: Present, s: State, at: Any, times: OfParts, y: Variables, moves: Flag
    ) -> tuple[Variables, Any]:
        """Where the optimiser's step leads, and its memory."""
        # A search that waits for others must not keep them with a line search of its own.
        gradient = jnp.where(moves, at.gradient, 0.0)
        with jax.numpy_dtype_promotion("standard"):  # optax mixes widths of numbers, which a strict session refuses
            memory = jax.tree.map(lambda a, b: jnp.where(s.fresh, a, b), self.optimiser.init(y), s.memory)
            updates, after = self.optimiser.update(
                gradient,
                memory,
                y,
                value=at.value,
                grad=gradient,
                value_fn=lambda y: lagrangian(y, task, which, s.held, times),
            )
            after = jax.tree.map(lambda new, old: jnp.asarray(new).astype(old.dtype), after, memory)
        return y + s.stride * updates.astype(y.dtype), after


def _better(here: Point, best: Point) -> Flag:
    rounding = ROUNDING * (1 + jnp.abs(best.value))
    lower = here.value < best.value - rounding
    return lower | ((here.value <= best.value + rounding) & (here.size < best.size))


def _next_round(s: State, best: Point, solved: Flag, rounds: Int[Array | np.ndarray, ""]) -> State:
    """The state at the beginning of the next round, from the best point of the last one."""
    held = s.held
    residual = jnp.max(jnp.abs(best.force - held.multipliers)) / held.penalty
    violation = jnp.max(best.peaks.value)
    settled = (violation <= FEASIBLE) & (best.size <= STATIONARY) & (residual <= COMPLEMENTARY)
    exact = solved | s.stuck
    slow = exact & (residual > SUFFICIENT_DECREASE * s.residual)
    hopeless = jnp.where(exact, jnp.where(residual > HOPELESS_DECREASE * s.residual, s.hopeless + 1, 0), s.hopeless)
    leads = LAST_PART * best.step >= (LAST_PART - 1) * s.step
    stride = jnp.where(exact | leads, 1.0, SHORTER) * s.stride
    finer = jnp.clip(OF_RESIDUAL * residual, FINEST, s.tolerance)
    lost = (hopeless >= HOPELESS_ROUNDS) | (held.penalty > HIGHEST_PENALTY) | (stride < SHORTEST)
    lost = lost | ~jnp.isfinite(best.value)
    return s._replace(
        y=best.y,
        fresh=jnp.ones_like(s.fresh),
        stuck=jnp.zeros_like(s.stuck),
        best=best,
        held=parts(
            held._replace(
                multipliers=jnp.where(exact, best.force, held.multipliers),
                penalty=jnp.where(slow, PENALTY_GROWTH, 1.0) * held.penalty,
            ),
            best.times,
            best.peaks,
        ),
        stride=stride,
        tolerance=jnp.where(exact, finer, s.tolerance),
        residual=jnp.where(exact, residual, s.residual),
        hopeless=hopeless,
        round=s.round + 1,
        step=jnp.zeros_like(s.step),
        steps=s.steps + 1,
        done=settled | lost | (s.round + 1 >= rounds),
        settled=settled,
    )
