"""The augmented Lagrangian of a tuning problem (Powell–Hestenes–Rockafellar) over the cells of a time grid.

Time is divided into cells, and every limit is a constraint on its largest value in each cell, with its own multiplier:
what holds in the cells holds between the nodes. The largest value in a cell is a continuous function of the variables,
whichever peaks come and go, and its gradient is that at the time where it stands (envelope theorem).

The box of the variables is met by z = m + r sin((y − m)/r), whose y is not bounded. A variable reaches its bound at a
finite y, where the curvature in y is the multiplier of the bound: there, too, a minimum is a regular one.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.constraints import Setting, slopes, values
from qtraj.design.tuning.curves import changes
from qtraj.design.tuning.model import setting
from qtraj.design.tuning.peaks import NODES, PEAKS, TOO_MUCH, Peaks, find_peaks
from qtraj.design.tuning.problem import Variables
from qtraj.design.tuning.task import SLOTS, Present, Task
from qtraj.foundation.least import place_of_largest
from qtraj.foundation.types import Scalar

CELLS = NODES
"""Cells of time, one about each node of the search for peaks."""

NEAR = 1 - 1e-4
"""A start on a bound is moved to this part of the way there: on the bound itself the gradient in y vanishes."""

OfCells = Float[Array, "slots cells"]


class Held(NamedTuple):
    """What stands still while the augmented Lagrangian is minimised; `margin` is added to every constraint."""

    multipliers: OfCells
    penalty: Scalar
    margin: Scalar


class Expanded(NamedTuple):
    """The augmented Lagrangian at one point: its value, its gradient in y, and the constraints there."""

    value: Scalar
    gradient: Variables
    cost: Scalar
    g: OfCells


def inside(task: Task, y: Variables) -> Variables:
    """z of y."""
    middle, half, safe = _box(task)
    return middle + half * jnp.sin((y - middle) / safe)


def outside(task: Task, z: Variables) -> Variables:
    """y of z; of a z on a bound, one near it."""
    middle, _, safe = _box(task)
    return middle + safe * jnp.arcsin(jnp.clip((z - middle) / safe, -NEAR, NEAR))


def _box(task: Task) -> tuple[Variables, Variables, Variables]:
    half = (task.high - task.low) / 2
    return (task.low + task.high) / 2, half, jnp.where(half > 0, half, 1.0)


def worst_times(task: Task, which: Present, y: Variables) -> tuple[OfCells, Peaks]:
    """Where in each cell each limit is largest, as fractions of the duration, and the peaks of the limits."""
    here = setting(task.problem, inside(task, y))
    peaks = find_peaks(here, which, task.limits)
    looks = jnp.linspace(0.0, 1.0, 2 * CELLS - 1, dtype=y.dtype)  # the nodes, and the borders between the cells
    places = jnp.clip(2 * jnp.arange(CELLS)[None] + jnp.arange(-1, 2)[:, None], 0, 2 * CELLS - 2)

    def of_slot(slot: Int[Array, ""], found: Array) -> Array:
        g = values(here, jnp.asarray(which.index)[slot], task.limits[slot], looks)
        seen, own = jnp.where(jnp.isfinite(g), g, TOO_MUCH)[places], peaks.time[slot]
        cell = jnp.round(own * (CELLS - 1)).astype(jnp.int32)
        there = peaks.present[slot][:, None] & (cell[:, None] == jnp.arange(CELLS)[None])
        heights = jnp.concatenate([jnp.where(there, peaks.value[slot][:, None], -jnp.inf), seen])
        times = jnp.concatenate([jnp.broadcast_to(own[:, None], (PEAKS, CELLS)), looks[places]])
        highest = jax.vmap(place_of_largest, in_axes=1)(heights)
        return found.at[slot].set(jnp.sum(jnp.where(jnp.arange(PEAKS + 3)[:, None] == highest, times, 0.0), axis=0))

    nothing = jnp.zeros((SLOTS, CELLS), y.dtype)
    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, nothing), peaks


def expand(task: Task, which: Present, held: Held, times: OfCells, y: Variables) -> Expanded:
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
        g = jnp.where(known, value, TOO_MUCH) + held.margin
        force = jnp.maximum(m[slot] + penalty * g, 0.0)
        added = jnp.sum(force**2 - m[slot] ** 2) / (2 * penalty)
        pull = jnp.where(known[None], slope, 0.0) @ force
        return total + added, gradient + pull, rows.at[slot].set(g)

    start = task.weight * cost, task.weight * of_cost, jnp.full_like(times, -jnp.inf)
    value, gradient, g = jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, start)
    return Expanded(value, gradient * outer, cost, g)


@eqx.filter_custom_jvp
def lagrangian(y: Variables, task: Task, which: Present, held: Held, times: OfCells) -> Scalar:
    """The value of `expand`; it can be differentiated in y alone, forward and in reverse."""
    return expand(task, which, held, times, y).value


@lagrangian.def_jvp
def _differentiate(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Scalar, Scalar]:
    y, *rest = primals
    at = expand(*rest[:-1], rest[-1], y)
    return at.value, at.gradient @ tangents[0]
