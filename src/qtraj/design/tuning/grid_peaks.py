"""Find and refine the highest peaks of each constraint of one problem in JAX, for the optimisers of optax."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.peaks import GRID, NODES, OFFSETS
from qtraj.design.tuning.task import Task, constraint_values

REFINED, SIZE = 4, 6
"""Number of local maxima that are refined, starting with the highest, and of these maxima and both ends together."""

ROUNDS = (1.0, 1 / 16)
"""Half-widths of the intervals in the rounds of refinement, in units of the distance to the next nodes."""

MIN_DISTANCE = 1e-5
"""Peaks count as equal if their times differ by less than this fraction of the duration."""


class GridPeaks(NamedTuple):
    """The peaks of all constraints, and the ends of the path; `present` marks the elements that are in use."""

    time: Float[Any, "limits k"]  # fractions of the duration
    present: Bool[Any, "limits k"]
    value: Float[Any, "limits k"]


def no_peaks(limits: int, dtype: Any) -> GridPeaks:
    """Return peaks without any used element."""
    zeros = np.zeros((limits, SIZE), dtype)
    return GridPeaks(zeros, zeros > 0, zeros + ABSENT)


def find_peaks(task: Task, z: Float[Array, " n"]) -> GridPeaks:
    """Find the peaks and ends of all limits of one problem."""
    count = len(task.limits)
    grid = jnp.broadcast_to(jnp.asarray(GRID), (count, NODES))
    g = constraint_values(task, z, grid)
    inner = g[:, 1:-1]
    heights = jnp.where((inner > g[:, :-2]) & (inner >= g[:, 2:]), inner, -jnp.inf)
    values, node = jax.lax.top_k(heights, REFINED)
    time, present = jnp.asarray(GRID)[node + 1], values > -jnp.inf
    reach = 0.5 * (jnp.asarray(GRID)[node + 2] - jnp.asarray(GRID)[node])
    offsets = jnp.asarray(OFFSETS[:, 0])
    for width in ROUNDS:
        u = jnp.clip(time[:, :, None] + width * reach[:, :, None] * offsets, 0.0, 1.0)
        at = constraint_values(task, z, u.reshape(count, -1)).reshape(u.shape)
        time = _top_of_parabola(u, at)
    ends = jnp.broadcast_to(jnp.asarray([0.0, 1.0]), (count, 2))
    time = jnp.concatenate([time, ends], axis=1)
    present = jnp.concatenate([present, jnp.ones((count, 2), bool)], axis=1)
    present = present & ~_duplicates(time, present)
    value = constraint_values(task, z, time)
    return GridPeaks(time, present, jnp.where(present, value, ABSENT))


def _top_of_parabola(u: Float[Array, "limits k m"], g: Float[Array, "limits k m"]) -> Float[Array, "limits k"]:
    """Return the time of the maximum of the parabola through the highest value and its neighbours."""
    best = jnp.argmax(g, axis=2)
    inner = jnp.clip(best, 1, u.shape[2] - 2)

    def take(x: Array, k: int) -> Array:
        return jnp.take_along_axis(x, (inner + k)[:, :, None], axis=2)[:, :, 0]

    (a, b, c), (low, middle, high) = ((take(x, -1), take(x, 0), take(x, 1)) for x in (u, g))
    curvature = 2 * middle - low - high
    safe = jnp.where(curvature > 0, curvature, 1.0)
    top = b + jnp.where(curvature > 0, 0.25 * (c - a) * (high - low) / safe, 0.0)
    edge = jnp.where(best < inner, a, c)
    return jnp.where(best == inner, jnp.clip(top, a, c), edge)


def _duplicates(time: Float[Array, "limits k"], present: Bool[Array, "limits k"]) -> Bool[Array, "limits k"]:
    """Return a mask of the times that repeat an earlier peak, whose multipliers would not be unique."""
    k = time.shape[1]
    earlier = jnp.arange(k)[None] < jnp.arange(k)[:, None]
    return jnp.any(earlier & present[:, None] & (jnp.abs(time[:, None] - time[:, :, None]) < MIN_DISTANCE), axis=2)
