"""The local model at one point: the cost and the constraints with their derivatives.

A peak moves with the variables so that ∂g/∂u = 0: its gradient is ∂g/∂z (envelope theorem), its Hessian
g_zz − g_zu g_uz/g_uu. A peak at an end of the path does not move. Constraints at fixed times between the peaks, with
gradients alone, predict new peaks that a step would raise.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.constraints import Setting, values
from qtraj.design.tuning.curves import CurveDerivatives, Curves, curve, curve_derivatives, reference_cubics
from qtraj.design.tuning.expansions import expansions, slopes
from qtraj.design.tuning.peaks import ABSENT, NODES, PEAKS, Peaks
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.task import LimitSlots, Task
from qtraj.foundation.derivatives import with_derivatives
from qtraj.foundation.types import Scalar

NODE_STRIDE = 8
"""Every eighth node is a fixed time, with a constraint of its own."""

FIXED_TIMES = len(range(NODE_STRIDE, NODES - 1, NODE_STRIDE))
PER_LIMIT = PEAKS + FIXED_TIMES
"""Number of constraints for each limit: peaks and ends first, then fixed times."""

MAX_DRIFT = 0.1
"""How far a peak is followed during one step, at most; a fraction of the duration."""


class Constraints(NamedTuple):
    """The constraints of all limits, linearised."""

    value: Float[Array, "slots r"]
    slope: Float[Array, "slots r n"]
    time: Float[Array, "slots r"]
    curvature: Float[Array, "slots peaks n n"]
    drift: Float[Array, "slots peaks n"]  # derivatives of the peaks' times in the variables


class Model(NamedTuple):
    """The local model of the problem at one point."""

    slope: Variables  # of the cost
    curvature: Float[Array, "n n"]
    constraints: Constraints


def make_setting(problem: Problem, z: Variables) -> Setting:
    """The path for the variables `z`, in unit time."""
    slopes, log_duration = problem.slopes(z)
    return setting(problem, curve(problem, slopes), log_duration)


def setting(problem: Problem, curves: Curves, log_duration: Scalar) -> Setting:
    """The surroundings of a path in unit time, with what it has in common with all paths of the problem."""
    return Setting(curves, log_duration, problem.axes, reference_cubics(problem), problem.road)


def build(task: Task, slots: LimitSlots, z: Variables, peaks: Peaks) -> Model:
    """The cost and the constraints at `z`, with their derivatives."""
    _, slope, curvature = with_derivatives(task.problem.cost, z)
    slopes, log_duration = task.problem.slopes(z)
    at, derivatives = curve_derivatives(task.problem, z, slopes)
    here = setting(task.problem, at, log_duration)
    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)[NODE_STRIDE:-1:NODE_STRIDE]
    n = z.shape[0]

    def of_slot(slot: Int[Array, ""], carry: Constraints) -> Constraints:
        index, limit = jnp.asarray(slots.index)[slot], task.limits[slot]
        peak = jax.tree.map(lambda x: x[slot], peaks)
        one = _constraints(here, derivatives, index, limit, peak, nodes)
        return jax.tree.map(lambda x, one: x.at[slot].set(one), carry, one)

    count = task.limits.shape[0]
    empty = Constraints(
        jnp.full((count, PER_LIMIT), ABSENT, z.dtype),
        jnp.zeros((count, PER_LIMIT, n), z.dtype),
        jnp.zeros((count, PER_LIMIT), z.dtype),
        jnp.zeros((count, PEAKS, n, n), z.dtype),
        jnp.zeros((count, PEAKS, n), z.dtype),
    )
    return Model(slope, curvature, jax.lax.fori_loop(0, jnp.asarray(slots.count), of_slot, empty))


def values_nearby(
    task: Task, slots: LimitSlots, z: Variables, step: Variables, constraints: Constraints
) -> Float[Array, "slots r"]:
    """The constraint values at `z`, one `step` from the point of `constraints`; the times of peaks drift along."""
    here = make_setting(task.problem, z)

    def of_slot(slot: Int[Array, ""], carry: Array) -> Array:
        shift = jnp.clip(constraints.drift[slot] @ step, -MAX_DRIFT, MAX_DRIFT)
        times = jnp.clip(constraints.time[slot] + jnp.pad(shift, (0, FIXED_TIMES)), 0.0, 1.0)
        new = values(here, jnp.asarray(slots.index)[slot], task.limits[slot], times)
        old = constraints.value[slot]
        return carry.at[slot].set(jnp.where(old > ABSENT, jnp.where(jnp.isfinite(new), new, old), ABSENT))

    return jax.lax.fori_loop(0, jnp.asarray(slots.count), of_slot, jnp.full_like(constraints.value, ABSENT))


def _constraints(
    here: Setting,
    derivatives: CurveDerivatives,
    index: Int[Array, ""],
    limit: Scalar,
    peak: Peaks,
    nodes: Float[Array, " fixed"],
) -> Constraints:
    """The constraints of one limit."""
    g = expansions(here, derivatives, index, limit, peak.time)
    is_maximum = peak.moving & (g.second_rate < 0)
    inv_second_rate = jnp.where(is_maximum, 1 / jnp.where(is_maximum, g.second_rate, 1.0), 0.0)
    drift = -inv_second_rate[None] * g.mixed
    # At the peak itself: the search in time found it only approximately.
    slope = g.slope + drift * g.rate[None]
    curvature = g.curvature + drift[:, None] * g.mixed[None]
    valid = peak.present & jnp.all(jnp.isfinite(slope), 0) & jnp.all(jnp.isfinite(curvature), (0, 1))
    node_value, node_slope = slopes(here, derivatives, index, limit, nodes)
    at_node = jnp.isfinite(node_value) & jnp.all(jnp.isfinite(node_slope), axis=0)
    both = jnp.concatenate([jnp.where(valid[None], slope, 0.0), jnp.where(at_node[None], node_slope, 0.0)], axis=1)
    return Constraints(
        jnp.concatenate([peak.value, jnp.where(at_node, node_value, ABSENT)]),
        both.T,
        jnp.concatenate([peak.time, nodes]),
        jnp.moveaxis(jnp.where(valid[None, None], curvature, 0.0), 2, 0),
        jnp.where(valid[None], drift, 0.0).T,
    )
