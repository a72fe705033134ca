"""The augmented Lagrangian of a tuning problem (Powell–Hestenes–Rockafellar), over intervals of time.

At the beginning of an outer iteration (a round), the time is divided for each limit into intervals, one about each peak
of the limited quantity. The largest value in each interval is a constraint with its own multiplier. This value is a
continuous function of the variables, even if peaks move between intervals, appear or vanish. The gradient of the
largest value is evaluated at the maximum (envelope theorem).

The substitution z = c + r sin((y − c)/r), with the centre c and the half-width r of the bounds, satisfies the bounds
for any y. A variable reaches its bound at a finite y. At this y, the second derivative of the Lagrangian with respect
to y is proportional to the multiplier of the bound, so a minimum on a bound is regular, too.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.constraints import of_one_path, values
from qtraj.design.tuning.curves import curve_derivatives
from qtraj.design.tuning.expansions import slopes
from qtraj.design.tuning.model import make_setting, setting
from qtraj.design.tuning.peaks import ABSENT, PEAKS, TOO_MUCH, Peaks, find_peaks, transfer_multipliers
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import LimitSlots, Task, over_slots
from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.indexing import element, with_element
from qtraj.foundation.types import Scalar

MAX_FRACTION = 1 - 1e-4
"""A start on a bound is moved to this fraction of the half-width from the centre; on the bound, ∂z/∂y would be zero."""

PerInterval = Float[Array, "slots k"]


class Round(NamedTuple):
    """The constants of one round: the time intervals [low, high], their multipliers, and the penalty."""

    valid: Bool[Array, "slots k"]  # false for unused elements
    low: PerInterval
    high: PerInterval
    multipliers: PerInterval
    penalty: Scalar


class Expanded(NamedTuple):
    """The augmented Lagrangian at a point y (see the module): value, gradient, cost, and constraint values g."""

    value: Scalar
    gradient: Variables
    cost: Scalar
    g: PerInterval


def to_box(task: Task, y: Any, xp: Any = jnp) -> Any:
    """Return the variables z(y) of one problem or a batch; `xp` is the module of the array y, NumPy or jax.numpy."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    return middle + half * xp.sin((y - middle) / xp.where(half > 0, half, 1.0))


def from_box(task: Task, z: Variables) -> Variables:
    """Return y for the variables z; variables on a bound are moved slightly inside."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    safe = jnp.where(half > 0, half, 1.0)
    return middle + safe * jnp.arcsin(jnp.clip((z - middle) / safe, -MAX_FRACTION, MAX_FRACTION))


def make_round(round_: Round, times: PerInterval, peaks: Peaks) -> Round:
    """Return a round with intervals about `peaks`, and with the multipliers of the previous intervals.

    `times` are the times of the maxima in the previous intervals.
    """
    peak_times, other = peaks.time[:, :, None], peaks.time[:, None]
    valid = peaks.present[:, None]
    middle = (peak_times + other) / 2
    low = jnp.max(jnp.where(valid & (other < peak_times), middle, 0.0), axis=2)
    high = jnp.min(jnp.where(valid & (other > peak_times), middle, 1.0), axis=2)
    return Round(peaks.present, low, high, transfer_multipliers(round_.multipliers, times, peaks), round_.penalty)


def interval_maxima(task: Task, slots: LimitSlots, round_: Round, y: Variables) -> tuple[PerInterval, Peaks]:
    """Return the times of the maxima in all intervals, as fractions of the duration, and the current peaks."""
    here = make_setting(task.problem, to_box(task, y))
    one = jax.tree.map(lambda x: x[None], (here, task.limits))
    peaks = jax.tree.map(lambda x: x[0], find_peaks(one[0], slots, one[1]))

    def of_slot(slot: Int[Array, ""], carry: Array) -> Array:
        low, high, slot_peaks = element((round_.low, round_.high, peaks), slot)
        peak_times = slot_peaks.time
        places = jnp.concatenate([low, high])
        g = of_one_path(values)(here, *element((slots.index, task.limits), slot), places)
        ends = jnp.where(jnp.isfinite(g), g, TOO_MUCH).reshape(2, PEAKS)
        within = slot_peaks.present[:, None] & (peak_times[:, None] >= low[None]) & (peak_times[:, None] <= high[None])
        heights = jnp.concatenate([jnp.where(within, slot_peaks.value[:, None], -jnp.inf), ends])
        times = jnp.concatenate([jnp.broadcast_to(peak_times[:, None], (PEAKS, PEAKS)), low[None], high[None]])
        highest = min_and_argmin(-heights)[1]
        chosen = jnp.arange(PEAKS + 2, dtype=jnp.int32)[:, None] == highest[None]
        return with_element(carry, slot, jnp.sum(jnp.where(chosen, times, 0.0), axis=0))

    return over_slots(slots, of_slot, jnp.zeros_like(round_.low)), peaks


def expand(task: Task, slots: LimitSlots, round_: Round, times: PerInterval, y: Variables) -> Expanded:
    """Evaluate the augmented Lagrangian weight·cost + Σ (max(0, m + μg)² − m²)/(2μ) and its gradient.

    The sum is over the constraints g at `times`, with the multipliers m and the penalty μ.
    """
    z, scale = jax.jvp(lambda y: to_box(task, y), (y,), (jnp.ones_like(y),))  # the Jacobian is diagonal
    cost, cost_gradient = jax.value_and_grad(task.problem.cost)(z)
    ends, log_duration = task.problem.slopes(z)
    at, derivatives = curve_derivatives(task.problem, z, ends)
    here = setting(task.problem, at, log_duration)
    penalty = round_.penalty

    def of_slot(slot: Int[Array, ""], carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        total, gradient, constraints = carry
        own = element((slots.index, task.limits, times), slot)
        value, slope = of_one_path(slopes)(here, derivatives, *own)
        valid, m = element((round_.valid, round_.multipliers), slot)
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), axis=0)
        g = jnp.where(valid, jnp.where(finite, value, TOO_MUCH), ABSENT)
        multiplier = jnp.maximum(m + penalty * g, 0.0)
        added = jnp.sum(multiplier**2 - m**2) / (2 * penalty)
        from_limit = jnp.where(finite[None], slope, 0.0) @ multiplier
        return total + added, gradient + from_limit, with_element(constraints, slot, g)

    start = task.weight * cost, task.weight * cost_gradient, jnp.full_like(times, ABSENT)
    value, gradient, g = over_slots(slots, of_slot, start)
    return Expanded(value, gradient * scale, cost, g)


@eqx.filter_custom_jvp
def lagrangian(y: Variables, task: Task, slots: LimitSlots, round_: Round, times: PerInterval) -> Scalar:
    """Return the value of `expand`; in forward and reverse mode, it is differentiable with respect to y only."""
    return expand(task, slots, round_, times, y).value


@lagrangian.def_jvp
def _differentiate(
    primals: tuple[Variables, Task, LimitSlots, Round, PerInterval], tangents: tuple[Any, ...]
) -> tuple[Scalar, Scalar]:
    y, task, slots, round_, times = primals
    at = expand(task, slots, round_, times, y)
    return at.value, at.gradient @ tangents[0]
