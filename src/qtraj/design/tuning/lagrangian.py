"""The augmented Lagrangian of a tuning problem (Powell–Hestenes–Rockafellar), over parts of the time.

Each limit divides the time into parts, one about each of its peaks at the beginning of a round, and its largest value
in each part is a constraint with a multiplier of its own. That value is a continuous function of the variables while
peaks move from part to part, come and go, and its gradient is that at the time where it stands (envelope theorem).

The box of the variables is met by z = m + r sin((y − m)/r), whose y is not bounded. A variable reaches its bound at a
finite y, where the curvature in y is the multiplier of the bound: there, too, a minimum is a regular one.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.constraints import Setting, values
from qtraj.design.tuning.curves import changes, given
from qtraj.design.tuning.expansions import slopes
from qtraj.design.tuning.model import setting
from qtraj.design.tuning.peaks import ABSENT, PEAKS, TOO_MUCH, Peaks, find_peaks, hand_over
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.types import Scalar

NEAR = 1 - 1e-4
"""A start on a bound is moved to this part of the way there: on the bound itself the gradient in y vanishes."""

OfParts = Float[Array, "slots k"]


class Held(NamedTuple):
    """What stands still in one round: the parts of the time, [low, high], their multipliers, and the penalty."""

    there: Bool[Array, "slots k"]  # or else there is no such part
    low: OfParts
    high: OfParts
    multipliers: OfParts
    penalty: Scalar


class Expanded(NamedTuple):
    """The augmented Lagrangian at one point: its value, its gradient in y, and the constraints there."""

    value: Scalar
    gradient: Variables
    cost: Scalar
    g: OfParts


def inside(task: Task, y: Any, xp: Any = jnp) -> Any:
    """z of y, of one problem or many; `xp` is NumPy or JAX's NumPy, as y is."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    return middle + half * xp.sin((y - middle) / xp.where(half > 0, half, 1.0))


def outside(task: Task, z: Variables) -> Variables:
    """y of z; of a z on a bound, one near it."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    safe = jnp.where(half > 0, half, 1.0)
    return middle + safe * jnp.arcsin(jnp.clip((z - middle) / safe, -NEAR, NEAR))


def parts(held: Held, times: OfParts, peaks: Peaks) -> Held:
    """Parts about these peaks, with the multipliers that the parts before had at the given times."""
    own, other = peaks.time[:, :, None], peaks.time[:, None]
    there = peaks.present[:, None]
    middle = (own + other) / 2
    low = jnp.max(jnp.where(there & (other < own), middle, 0.0), axis=2)
    high = jnp.min(jnp.where(there & (other > own), middle, 1.0), axis=2)
    return Held(peaks.present, low, high, hand_over(held.multipliers, times, peaks), held.penalty)


def worst_times(task: Task, which: Present, held: Held, y: Variables) -> tuple[OfParts, Peaks]:
    """Where in each part of the time each limit is largest, as fractions of the duration, and the peaks there."""
    here = setting(task.problem, inside(task, y))
    peaks = find_peaks(here, which, task.limits)

    def of_slot(slot: Int[Array, ""], found: Array) -> Array:
        low, high, own = held.low[slot], held.high[slot], peaks.time[slot]
        g = values(here, jnp.asarray(which.index)[slot], task.limits[slot], jnp.concatenate([low, high]))
        ends = jnp.where(jnp.isfinite(g), g, TOO_MUCH).reshape(2, PEAKS)
        within = peaks.present[slot][:, None] & (own[:, None] >= low[None]) & (own[:, None] <= high[None])
        heights = jnp.concatenate([jnp.where(within, peaks.value[slot][:, None], -jnp.inf), ends])
        times = jnp.concatenate([jnp.broadcast_to(own[:, None], (PEAKS, PEAKS)), low[None], high[None]])
        highest = min_and_argmin(-heights)[1]
        chosen = jnp.arange(PEAKS + 2, dtype=jnp.int32)[:, None] == highest[None]
        return found.at[slot].set(jnp.sum(jnp.where(chosen, times, 0.0), axis=0))

    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, jnp.zeros_like(held.low)), peaks


def expand(task: Task, which: Present, held: Held, times: OfParts, y: Variables) -> Expanded:
    """The augmented Lagrangian cost + Σ (max(0, m + μg)² − m²)/(2μ), with the constraints g at the given times."""
    z, outer = jax.jvp(lambda y: inside(task, y), (y,), (jnp.ones_like(y),))  # the map is diagonal
    cost, of_cost = jax.value_and_grad(task.problem.cost)(z)
    ends, log_duration = task.problem.slopes(z)
    at, changed = changes(task.problem, z, ends)
    here = Setting(at, log_duration, task.problem.axes, given(task.problem))
    m, penalty = held.multipliers, held.penalty

    def of_slot(slot: Int[Array, ""], found: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        total, gradient, rows = found
        value, slope = slopes(here, changed, jnp.asarray(which.index)[slot], task.limits[slot], times[slot])
        known = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), axis=0)
        g = jnp.where(held.there[slot], jnp.where(known, value, TOO_MUCH), ABSENT)
        force = jnp.maximum(m[slot] + penalty * g, 0.0)
        added = jnp.sum(force**2 - m[slot] ** 2) / (2 * penalty)
        pull = jnp.where(known[None], slope, 0.0) @ force
        return total + added, gradient + pull, rows.at[slot].set(g)

    start = task.weight * cost, task.weight * of_cost, jnp.full_like(times, ABSENT)
    value, gradient, g = jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, start)
    return Expanded(value, gradient * outer, cost, g)


@eqx.filter_custom_jvp
def lagrangian(y: Variables, task: Task, which: Present, held: Held, times: OfParts) -> Scalar:
    """The value of `expand`; it can be differentiated in y alone, forward and in reverse."""
    return expand(task, which, held, times, y).value


@lagrangian.def_jvp
def _differentiate(
    primals: tuple[Variables, Task, Present, Held, OfParts], tangents: tuple[Any, ...]
) -> tuple[Scalar, Scalar]:
    y, task, which, held, times = primals
    at = expand(task, which, held, times, y)
    return at.value, at.gradient @ tangents[0]
