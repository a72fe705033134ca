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

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.grid_peaks import GridPeaks, find_peaks
from qtraj.design.tuning.task import Task, constraint_values
from qtraj.foundation.types import Scalar

MAX_FRACTION = 1 - 1e-4
"""A start on a bound is moved to this fraction of the half-width from the centre; on the bound, ∂z/∂y would be zero."""

PerInterval = Float[Array, "limits k"]


class Round(NamedTuple):
    """The constants of one round: the time intervals [low, high], their multipliers, and the penalty."""

    valid: Bool[Array, "limits k"]  # false for unused elements
    low: PerInterval
    high: PerInterval
    multipliers: PerInterval
    penalty: Scalar


class Expanded(NamedTuple):
    """The augmented Lagrangian at a point y (see the module): value, gradient, cost, and constraint values g."""

    value: Scalar
    gradient: Float[Array, " n"]
    cost: Scalar
    g: PerInterval


def to_box(task: Task, y: Any) -> Any:
    """Return the variables z(y) of one problem or a batch."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    return middle + half * jnp.sin((y - middle) / jnp.where(half > 0, half, 1.0))


def from_box(task: Task, z: Array) -> Array:
    """Return y for the variables z; variables on a bound are moved slightly inside."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    safe = jnp.where(half > 0, half, 1.0)
    return middle + safe * jnp.arcsin(jnp.clip((z - middle) / safe, -MAX_FRACTION, MAX_FRACTION))


def make_round(round_: Round, times: PerInterval, peaks: GridPeaks) -> Round:
    """Return a round with intervals about `peaks`, and with the multipliers of the previous intervals.

    `times` are the times of the maxima in the previous intervals.
    """
    peak_times, other = peaks.time[:, :, None], peaks.time[:, None]
    valid = peaks.present[:, None]
    middle = (peak_times + other) / 2
    low = jnp.max(jnp.where(valid & (other < peak_times), middle, 0.0), axis=2)
    high = jnp.min(jnp.where(valid & (other > peak_times), middle, 1.0), axis=2)
    return Round(peaks.present, low, high, _transferred(round_.multipliers, times, peaks), round_.penalty)


def _transferred(multipliers: PerInterval, times: PerInterval, peaks: GridPeaks) -> PerInterval:
    """Assign the multipliers of constraints at `times` to the nearest peak or end of the same limit."""
    distance = jnp.abs(peaks.time[:, :, None] - times[:, None]) + jnp.where(peaks.present, 0.0, 2.0)[:, :, None]
    here = jnp.argmin(distance, axis=1)[:, None] == jnp.arange(peaks.time.shape[1])[None, :, None]
    return jnp.sum(jnp.where(here, multipliers[:, None], 0.0), axis=2)


def interval_maxima(task: Task, round_: Round, y: Array) -> tuple[PerInterval, GridPeaks]:
    """Return the times of the maxima in all intervals, as fractions of the duration, and the current peaks."""
    z = to_box(task, y)
    peaks = find_peaks(task, z)
    low, high, size = round_.low, round_.high, round_.low.shape[1]
    ends = constraint_values(task, z, jnp.concatenate([low, high], axis=1))
    within = (
        peaks.present[:, :, None] & (peaks.time[:, :, None] >= low[:, None]) & (peaks.time[:, :, None] <= high[:, None])
    )
    heights = jnp.concatenate([jnp.where(within, peaks.value[:, :, None], -jnp.inf), ends.reshape(-1, 2, size)], axis=1)
    times = jnp.concatenate(
        [jnp.broadcast_to(peaks.time[:, :, None], within.shape), low[:, None], high[:, None]], axis=1
    )
    highest = jnp.argmax(heights, axis=1)
    return jnp.take_along_axis(times, highest[:, None], axis=1)[:, 0], peaks


def lagrangian(task: Task, round_: Round, times: PerInterval, y: Array) -> tuple[Scalar, tuple[Scalar, PerInterval]]:
    """Return the augmented Lagrangian cost + Σ (max(0, m + μg)² − m²)/(2μ), the cost, and the constraint values g.

    The sum is over the constraints g at `times`, with the multipliers m and the penalty μ.
    """
    z = to_box(task, y)
    cost, m = task.problem.cost(z), round_.multipliers
    g = jnp.where(round_.valid, constraint_values(task, z, times), ABSENT)
    multiplier = jnp.maximum(m + round_.penalty * g, 0.0)
    return cost + jnp.sum(multiplier**2 - m**2) / (2 * round_.penalty), (cost, g)


def expand(task: Task, round_: Round, times: PerInterval, y: Array) -> Expanded:
    """Return the augmented Lagrangian and its gradient."""
    evaluate = jax.value_and_grad(lambda y: lagrangian(task, round_, times, y), has_aux=True)
    (value, (cost, g)), gradient = evaluate(y)
    return Expanded(value, gradient, cost, g)
