"""The local model of a problem at one point: the cost and the constraints with their derivatives.

The time u of a peak of a constraint g changes with the variables z so that ∂g/∂u = 0. The gradient of the peak's value
is ∂g/∂z (envelope theorem), and the Hessian of this value is g_zz − g_zu g_uz/g_uu. The time of a peak at an end of the
path is constant. Additional constraints at fixed times, with first derivatives only, predict new peaks after a step.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.constraints import Setting, values
from qtraj.design.tuning.curves import CurveDerivatives, Curves, curve, curve_derivatives, reference_cubics
from qtraj.design.tuning.expansions import Expansion, expansions, slopes
from qtraj.design.tuning.peaks import ABSENT, NODES, PEAKS, Peaks
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.task import LimitSlots, Task, over_slots
from qtraj.foundation.derivatives import with_derivatives
from qtraj.foundation.indexing import element, with_element
from qtraj.foundation.types import Scalar

NODE_STRIDE = 8
"""Every eighth node of the grid is a fixed time with its own constraint."""

FIXED_TIMES = len(range(NODE_STRIDE, NODES - 1, NODE_STRIDE))
PER_LIMIT = PEAKS + FIXED_TIMES
"""Number of constraints for each limit: first the peaks and ends, then the fixed times."""

MAX_DRIFT = 0.1
"""Maximum shift of the time of a peak during one step, as a fraction of the duration."""


class Constraints(NamedTuple):
    """The constraints of all limits, with their derivatives with respect to the n variables.

    The axis `r` has `PER_LIMIT` elements.
    """

    value: Float[Array, "*batch slots r"]
    slope: Float[Array, "*batch slots r n"]
    time: Float[Array, "*batch slots r"]
    curvature: Float[Array, "*batch slots peaks n n"]  # Hessians
    drift: Float[Array, "*batch slots peaks n"]  # derivatives of the times of the peaks with respect to the variables


class Model(NamedTuple):
    """The local model of the problem at one point."""

    slope: Float[Array, "*batch n"]  # gradient of the cost
    curvature: Float[Array, "*batch n n"]  # Hessian of the cost
    constraints: Constraints


@jax.jit
def make_setting(problem: Problem, z: Variables) -> Setting:
    """Return the data of the path for the variables `z`, for the evaluation of constraints."""
    slopes, log_duration = problem.slopes(z)
    return setting(problem, curve(problem, slopes), log_duration)


def setting(problem: Problem, curves: Curves, log_duration: Scalar) -> Setting:
    """Return the data of a path for the evaluation of constraints."""
    return Setting(curves, log_duration, problem.axes, reference_cubics(problem), problem.road)


def build(tasks: Task, slots: LimitSlots, z: Float[Array, "batch n"], peaks: Peaks) -> Model:
    """Build the local models of a batch of problems, each at its own `z`."""
    slope, curvature, here, derivatives = jax.vmap(differentiated)(tasks.problem, z)
    batch, n = z.shape
    nodes = jnp.asarray(np.linspace(0.0, 1.0, NODES)[NODE_STRIDE:-1:NODE_STRIDE], z.dtype)

    def of_slot(slot: Int[Array, ""], carry: Constraints) -> Constraints:
        index, (limits, peak) = element(slots.index, slot), element((tasks.limits, peaks), slot, 1)
        one = _constraints(here, derivatives, index, limits, peak, jnp.broadcast_to(nodes[None], (batch, FIXED_TIMES)))
        return with_element(carry, slot, one, 1)

    count = tasks.limits.shape[-1]
    empty = Constraints(
        jnp.full((batch, count, PER_LIMIT), ABSENT, z.dtype),
        jnp.zeros((batch, count, PER_LIMIT, n), z.dtype),
        jnp.zeros((batch, count, PER_LIMIT), z.dtype),
        jnp.zeros((batch, count, PEAKS, n, n), z.dtype),
        jnp.zeros((batch, count, PEAKS, n), z.dtype),
    )
    return Model(slope, curvature, over_slots(slots, of_slot, empty))


def differentiated(problem: Problem, z: Variables) -> tuple[Array, Array, Setting, CurveDerivatives]:
    """Return the gradient and the Hessian of the cost, the path, and the derivatives of the path."""
    if problem.objective.is_smooth:
        _, slope, curvature = with_derivatives(problem.cost, z)
    else:  # a user's function may have derivatives in reverse mode only
        gradient = jax.grad(problem.cost)
        slope, curvature = gradient(z), jax.jacfwd(gradient)(z)
    slopes, log_duration = problem.slopes(z)
    at, derivatives = curve_derivatives(problem, z, slopes)
    return slope, curvature, setting(problem, at, log_duration), derivatives


def values_nearby(
    tasks: Task, slots: LimitSlots, z: Float[Array, "batch n"], step: Float[Array, "batch n"], constraints: Constraints
) -> Float[Array, "batch slots r"]:
    """Return the constraint values at each `z`, which is one `step` away from the point of `constraints`.

    The times of the peaks are updated to first order.
    """
    here = jax.vmap(make_setting)(tasks.problem, z)
    parts = constraints.value, constraints.time, constraints.drift, tasks.limits

    def of_slot(slot: Int[Array, ""], carry: Array) -> Array:
        old, time, drift, limits = element(parts, slot, 1)
        shift = jnp.clip(jnp.sum(drift * step[:, None], axis=2), -MAX_DRIFT, MAX_DRIFT)
        times = jnp.clip(time + jnp.pad(shift, ((0, 0), (0, FIXED_TIMES))), 0.0, 1.0)
        new = values(here, element(slots.index, slot), limits, times)
        found = jnp.where(old > ABSENT, jnp.where(jnp.isfinite(new), new, old), ABSENT)
        return with_element(carry, slot, found, 1)

    return over_slots(slots, of_slot, jnp.full_like(constraints.value, ABSENT))


def _constraints(
    here: Setting,
    derivatives: CurveDerivatives,
    index: Int[Array, ""],
    limits: Float[Array, " batch"],
    peak: Peaks,
    nodes: Float[Array, "batch fixed"],
) -> Constraints:
    """Return the constraints of one limit for a batch of paths."""
    g = expansions(here, derivatives, index, limits, peak.time)
    node_value, node_slope = slopes(here, derivatives, index, limits, nodes)
    return jax.vmap(_linearised)(g, peak, nodes, node_value, node_slope)


def _linearised(
    g: Expansion,
    peak: Peaks,
    nodes: Float[Array, " fixed"],
    node_value: Float[Array, " fixed"],
    node_slope: Float[Array, "n fixed"],
) -> Constraints:
    """Return the constraints of one limit, from the expansions at the peaks and the derivatives at the fixed times."""
    is_maximum = peak.moving & (g.second_rate < 0)
    inv_second_rate = jnp.where(is_maximum, 1 / jnp.where(is_maximum, g.second_rate, 1.0), 0.0)
    drift = -inv_second_rate[None] * g.mixed
    # Correct the slope for the distance between the time of the exact peak and the time that the search found.
    slope = g.slope + drift * g.rate[None]
    curvature = g.curvature + drift[:, None] * g.mixed[None]
    valid = peak.present & jnp.all(jnp.isfinite(slope), 0) & jnp.all(jnp.isfinite(curvature), (0, 1))
    at_node = jnp.isfinite(node_value) & jnp.all(jnp.isfinite(node_slope), axis=0)
    both = jnp.concatenate([jnp.where(valid[None], slope, 0.0), jnp.where(at_node[None], node_slope, 0.0)], axis=1)
    return Constraints(
        jnp.concatenate([peak.value, jnp.where(at_node, node_value, ABSENT)]),
        both.T,
        jnp.concatenate([peak.time, nodes]),
        jnp.moveaxis(jnp.where(valid[None, None], curvature, 0.0), 2, 0),
        jnp.where(valid[None], drift, 0.0).T,
    )
