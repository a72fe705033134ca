"""The augmented Lagrangian of a tuning problem (Powell–Hestenes–Rockafellar), over equal parts of the time.

The largest value of each limit in each part is a constraint with a multiplier of its own. It changes smoothly with the
variables as long as a part holds one peak, also where a peak moves from part to part, comes or goes, and its gradient is
that at the time where it stands (envelope theorem).

The box of the variables is met by z = m + r sin((y − m)/r), whose y is not bounded. A variable reaches its bound at a
finite y, where the curvature in y is the multiplier of the bound: there, too, a minimum is a regular one.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.constraints import Setting, values
from qtraj.design.tuning.curves import changes
from qtraj.design.tuning.expansions import slopes
from qtraj.design.tuning.model import setting
from qtraj.design.tuning.peaks import ABSENT, PEAKS, TOO_MUCH, Peaks, find_peaks
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation.least import least
from qtraj.foundation.types import Scalar

NEAR = 1 - 1e-4
"""A start on a bound is moved to this part of the way there: on the bound itself the gradient in y vanishes."""

PARTS = 16

OfParts = Float[Array, "slots parts"]


class Held(NamedTuple):
    """What stands still in one round: the multipliers and the penalty."""

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


def worst_times(task: Task, which: Present, y: Variables) -> tuple[OfParts, Peaks]:
    """Where in each part of the time each limit is largest, as fractions of the duration, and the peaks there."""
    here = setting(task.problem, inside(task, y))
    peaks = find_peaks(here, which, task.limits)
    borders = jnp.linspace(0.0, 1.0, PARTS + 1, dtype=y.dtype)
    low, high = borders[None, :-1], borders[None, 1:]

    def of_slot(slot: Int[Array, ""], found: Array) -> Array:
        own, there = peaks.time[slot][:, None], peaks.present[slot][:, None]
        g = values(here, jnp.asarray(which.index)[slot], task.limits[slot], borders)
        ends = jnp.where(jnp.isfinite(g), g, TOO_MUCH)
        within = there & (own >= low) & (own <= high)
        heights = jnp.where(within, peaks.value[slot][:, None], -jnp.inf)
        heights = jnp.concatenate([heights, ends[None, :-1], ends[None, 1:]])
        times = jnp.concatenate([jnp.broadcast_to(own, (PEAKS, PARTS)), low, high])
        chosen = jnp.arange(PEAKS + 2, dtype=jnp.int32)[:, None] == least(-heights)[1][None]
        return found.at[slot].set(jnp.sum(jnp.where(chosen, times, 0.0), axis=0))

    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, jnp.zeros_like(task.limits[:, None] * low)), peaks


def expand(task: Task, which: Present, held: Held, times: OfParts, y: Variables) -> Expanded:
    """The augmented Lagrangian cost + Σ (max(0, m + μg)² − m²)/(2μ), with the constraints g at the given times."""
    z, outer = jax.jvp(lambda y: inside(task, y), (y,), (jnp.ones_like(y),))  # the map is diagonal
    cost, of_cost = jax.value_and_grad(task.problem.cost)(z)
    ends, log_duration = task.problem.slopes(z)
    at, changed = changes(task.problem, z, ends)
    here = Setting(at, log_duration, task.problem.axes)
    m, penalty = held.multipliers, held.penalty

    def of_slot(slot: Int[Array, ""], found: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        total, gradient, rows = found
        value, slope = slopes(here, changed, jnp.asarray(which.index)[slot], task.limits[slot], times[slot])
        known = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), axis=0)
        g = jnp.where(known, value, TOO_MUCH)
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
