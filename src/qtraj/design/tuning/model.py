"""The problem about one point: the cost and the constraints with their derivatives.

A peak moves with the variables so that ∂g/∂u = 0: its gradient is ∂g/∂z (envelope theorem), its Hessian
g_zz − g_zu g_uz/g_uu. At an end it stands still. Fixed times between the peaks, with gradients alone, foretell the
peaks that a step would raise.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.constraints import Setting, values
from qtraj.design.tuning.curves import Changes, changes, curve, given
from qtraj.design.tuning.expansions import expansions, slopes
from qtraj.design.tuning.peaks import ABSENT, NODES, PEAKS, Peaks
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.task import SLOTS, Present, Task
from qtraj.foundation.derivatives import with_derivatives
from qtraj.foundation.types import Scalar

STRIDE = 8
"""Every so many nodes one is a fixed time, with a constraint of its own."""

FIXED = len(range(STRIDE, NODES - 1, STRIDE))
ROWS = PEAKS + FIXED
"""Constraints of each limit: peaks and ends before fixed times."""

FOLLOWED = 0.1
"""So far a peak is followed through one step; a fraction of the duration."""


class Constraints(NamedTuple):
    """The constraints of all limits, linearised."""

    value: Float[Array, "slots rows"]
    slope: Float[Array, "slots rows n"]
    time: Float[Array, "slots rows"]
    curvature: Float[Array, "slots peaks n n"]
    drift: Float[Array, "slots peaks n"]  # how the times of peaks change with the variables


class Model(NamedTuple):
    """The problem about one point."""

    slope: Variables  # of the cost
    curvature: Float[Array, "n n"]
    constraints: Constraints


def setting(problem: Problem, z: Variables) -> Setting:
    """The path of the variables, in unit time."""
    slopes, log_duration = problem.slopes(z)
    return Setting(curve(problem, slopes), log_duration, problem.axes, given(problem))


def build(task: Task, which: Present, z: Variables, peaks: Peaks) -> Model:
    """The cost and the constraints at `z`, with their derivatives."""
    _, slope, curvature = with_derivatives(task.problem.cost, z)
    slopes, log_duration = task.problem.slopes(z)
    at, changed = changes(task.problem, z, slopes)
    here = Setting(at, log_duration, task.problem.axes, given(task.problem))
    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)[STRIDE:-1:STRIDE]
    n = z.shape[0]

    def of_slot(slot: Int[Array, ""], found: Constraints) -> Constraints:
        index, limit = jnp.asarray(which.index)[slot], task.limits[slot]
        own = jax.tree.map(lambda x: x[slot], peaks)
        one = _constraints(here, changed, index, limit, own, nodes)
        return jax.tree.map(lambda x, one: x.at[slot].set(one), found, one)

    nothing = Constraints(
        jnp.full((SLOTS, ROWS), ABSENT, z.dtype),
        jnp.zeros((SLOTS, ROWS, n), z.dtype),
        jnp.zeros((SLOTS, ROWS), z.dtype),
        jnp.zeros((SLOTS, PEAKS, n, n), z.dtype),
        jnp.zeros((SLOTS, PEAKS, n), z.dtype),
    )
    return Model(slope, curvature, jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, nothing))


def values_nearby(
    task: Task, which: Present, z: Variables, step: Variables, known: Constraints
) -> Float[Array, "slots rows"]:
    """The values at `z`, a step away from where the constraints are known: their peaks are followed there."""
    here = setting(task.problem, z)

    def of_slot(slot: Int[Array, ""], found: Array) -> Array:
        shift = jnp.clip(known.drift[slot] @ step, -FOLLOWED, FOLLOWED)
        times = jnp.clip(known.time[slot] + jnp.pad(shift, (0, FIXED)), 0.0, 1.0)
        there = values(here, jnp.asarray(which.index)[slot], task.limits[slot], times)
        own = known.value[slot]
        kept = jnp.where(own > ABSENT, jnp.where(jnp.isfinite(there), there, own), ABSENT)
        return found.at[slot].set(kept)

    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, jnp.full_like(known.value, ABSENT))


def _constraints(
    here: Setting, changed: Changes, index: Int[Array, ""], limit: Scalar, own: Peaks, nodes: Float[Array, " fixed"]
) -> Constraints:
    """The constraints of one limit."""
    g = expansions(here, changed, index, limit, own.time)
    bends = own.moving & (g.bend < 0)
    follows = jnp.where(bends, 1 / jnp.where(bends, g.bend, 1.0), 0.0)
    drift = -follows[None] * g.mixed
    # To the peak itself, which the search in time only came near to.
    slope = g.slope + drift * g.rate[None]
    curvature = g.curvature + drift[:, None] * g.mixed[None]
    kept = own.present & jnp.all(jnp.isfinite(slope), 0) & jnp.all(jnp.isfinite(curvature), (0, 1))
    value_there, slope_there = slopes(here, changed, index, limit, nodes)
    known = jnp.isfinite(value_there) & jnp.all(jnp.isfinite(slope_there), axis=0)
    both = jnp.concatenate([jnp.where(kept[None], slope, 0.0), jnp.where(known[None], slope_there, 0.0)], axis=1)
    return Constraints(
        jnp.concatenate([own.value, jnp.where(known, value_there, ABSENT)]),
        both.T,
        jnp.concatenate([own.time, nodes]),
        jnp.moveaxis(jnp.where(kept[None, None], curvature, 0.0), 2, 0),
        jnp.where(kept[None], drift, 0.0).T,
    )
