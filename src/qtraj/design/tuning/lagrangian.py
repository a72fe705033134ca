"""The augmented Lagrangian of a tuning problem (Powell–Hestenes–Rockafellar), over intervals of time.

At the beginning of a round each limit divides the time into intervals, one about each of its peaks. Its largest value
in each interval is a constraint with a multiplier of its own. That value is a continuous function of the variables,
even while peaks move between intervals, appear or vanish. Its gradient is taken at the maximum (envelope theorem).

The substitution z = m + r sin((y − m)/r) satisfies the bounds of the variables for any y. A variable reaches its bound
at a finite y, where the curvature in y is the multiplier of the bound, so a minimum there is regular as well.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.constraints import values
from qtraj.design.tuning.curves import curve_derivatives
from qtraj.design.tuning.expansions import slopes
from qtraj.design.tuning.model import make_setting, setting
from qtraj.design.tuning.peaks import ABSENT, PEAKS, TOO_MUCH, Peaks, find_peaks, transfer_multipliers
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import LimitSlots, Task
from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.types import Scalar

MAX_FRACTION = 1 - 1e-4
"""A start on a bound is moved inside, to this fraction of the half-width: on the bound the gradient in y vanishes."""

PerInterval = Float[Array, "slots k"]


class Round(NamedTuple):
    """The constants of one round: the intervals [low, high] of time, their multipliers, and the penalty."""

    valid: Bool[Array, "slots k"]  # false where there is no such interval
    low: PerInterval
    high: PerInterval
    multipliers: PerInterval
    penalty: Scalar


class Expanded(NamedTuple):
    """The augmented Lagrangian at one point: its value, its gradient in y, and the constraints there."""

    value: Scalar
    gradient: Variables
    cost: Scalar
    g: PerInterval


def to_box(task: Task, y: Any, xp: Any = jnp) -> Any:
    """The variables z for y, of one problem or a batch. `xp` is NumPy or JAX's NumPy, as y is."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    return middle + half * xp.sin((y - middle) / xp.where(half > 0, half, 1.0))


def from_box(task: Task, z: Variables) -> Variables:
    """y for the variables z; a z on a bound is moved slightly inside."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    safe = jnp.where(half > 0, half, 1.0)
    return middle + safe * jnp.arcsin(jnp.clip((z - middle) / safe, -MAX_FRACTION, MAX_FRACTION))


def make_round(round_: Round, times: PerInterval, peaks: Peaks) -> Round:
    """A round with intervals about these peaks, and the multipliers that the previous intervals had at `times`."""
    peak_times, other = peaks.time[:, :, None], peaks.time[:, None]
    valid = peaks.present[:, None]
    middle = (peak_times + other) / 2
    low = jnp.max(jnp.where(valid & (other < peak_times), middle, 0.0), axis=2)
    high = jnp.min(jnp.where(valid & (other > peak_times), middle, 1.0), axis=2)
    return Round(peaks.present, low, high, transfer_multipliers(round_.multipliers, times, peaks), round_.penalty)


def interval_maxima(task: Task, slots: LimitSlots, round_: Round, y: Variables) -> tuple[PerInterval, Peaks]:
    """The time of the maximum of each limit in each interval, as a fraction of the duration, and the current peaks."""
    here = make_setting(task.problem, to_box(task, y))
    peaks = find_peaks(here, slots, task.limits)

    def of_slot(slot: Int[Array, ""], carry: Array) -> Array:
        low, high, peak_times = round_.low[slot], round_.high[slot], peaks.time[slot]
        g = values(here, jnp.asarray(slots.index)[slot], task.limits[slot], jnp.concatenate([low, high]))
        ends = jnp.where(jnp.isfinite(g), g, TOO_MUCH).reshape(2, PEAKS)
        within = peaks.present[slot][:, None] & (peak_times[:, None] >= low[None]) & (peak_times[:, None] <= high[None])
        heights = jnp.concatenate([jnp.where(within, peaks.value[slot][:, None], -jnp.inf), ends])
        times = jnp.concatenate([jnp.broadcast_to(peak_times[:, None], (PEAKS, PEAKS)), low[None], high[None]])
        highest = min_and_argmin(-heights)[1]
        chosen = jnp.arange(PEAKS + 2, dtype=jnp.int32)[:, None] == highest[None]
        return carry.at[slot].set(jnp.sum(jnp.where(chosen, times, 0.0), axis=0))

    return jax.lax.fori_loop(0, jnp.asarray(slots.count), of_slot, jnp.zeros_like(round_.low)), peaks


def expand(task: Task, slots: LimitSlots, round_: Round, times: PerInterval, y: Variables) -> Expanded:
    """The augmented Lagrangian cost + Σ (max(0, m + μg)² − m²)/(2μ), with the constraints g at `times`."""
    z, scale = jax.jvp(lambda y: to_box(task, y), (y,), (jnp.ones_like(y),))  # the map is diagonal
    cost, cost_gradient = jax.value_and_grad(task.problem.cost)(z)
    ends, log_duration = task.problem.slopes(z)
    at, derivatives = curve_derivatives(task.problem, z, ends)
    here = setting(task.problem, at, log_duration)
    m, penalty = round_.multipliers, round_.penalty

    def of_slot(slot: Int[Array, ""], carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        total, gradient, constraints = carry
        value, slope = slopes(here, derivatives, jnp.asarray(slots.index)[slot], task.limits[slot], times[slot])
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), axis=0)
        g = jnp.where(round_.valid[slot], jnp.where(finite, value, TOO_MUCH), ABSENT)
        multiplier = jnp.maximum(m[slot] + penalty * g, 0.0)
        added = jnp.sum(multiplier**2 - m[slot] ** 2) / (2 * penalty)
        from_limit = jnp.where(finite[None], slope, 0.0) @ multiplier
        return total + added, gradient + from_limit, constraints.at[slot].set(g)

    start = task.weight * cost, task.weight * cost_gradient, jnp.full_like(times, ABSENT)
    value, gradient, g = jax.lax.fori_loop(0, jnp.asarray(slots.count), of_slot, start)
    return Expanded(value, gradient * scale, cost, g)


@eqx.filter_custom_jvp
def lagrangian(y: Variables, task: Task, slots: LimitSlots, round_: Round, times: PerInterval) -> Scalar:
    """The value of `expand`. It can be differentiated in y only, in forward and reverse mode."""
    return expand(task, slots, round_, times, y).value


@lagrangian.def_jvp
def _differentiate(
    primals: tuple[Variables, Task, LimitSlots, Round, PerInterval], tangents: tuple[Any, ...]
) -> tuple[Scalar, Scalar]:
    y, task, slots, round_, times = primals
    at = expand(task, slots, round_, times, y)
    return at.value, at.gradient @ tangents[0]
