"""Construct the steps of a propagation: the mesh between the output times, error estimates, and refinement.

The formulas are written for NumPy and for JAX. In NumPy a mesh has as many slots as steps; inside a trace, the number
of slots is fixed.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra import quaternion
from qtraj.algebra.vector import norm
from qtraj.foundation.namespace import matmul, stop_gradient, xp
from qtraj.foundation.types import Scalar
from qtraj.motion.propagation.gauss_legendre import lobatto
from qtraj.motion.propagation.increment import AbstractIncrement, constant, increments

MIN_STEPS = 8
"""Minimum number of initial steps; with fewer steps a short event could be missed."""

ROUND_OFF = 8
"""Error estimates below this multiple of the round-off are attributed to round-off, and the step is not split."""

MAX_HALVINGS = 3
"""A step is split into at most 2³ steps at a time."""


class Mesh(eqx.Module):
    """The steps of a propagation in order of time, stored in n slots.

    Step j runs from `start[j]` to `end[j]`, which are fractions of the output interval with the index `interval[j]`.
    Adaptive steps are split by halving, so their fractions are exact. Only the first `count` slots contain steps; the
    other slots contain empty steps at the end of the last interval.
    """

    interval: Int[Array, " n"]
    start: Float[Array, " n"]
    end: Float[Array, " n"]
    count: Int[Array, ""]

    @property
    def used(self) -> Bool[Array, " n"]:
        """Whether each slot contains a step."""
        return xp.arange(self.start.shape[0], dtype=np.int32) < self.count


def uniform(intervals: int, steps: int, slots: int | None = None) -> Mesh:
    """Return a mesh with `steps` equal steps in each of `intervals` output intervals.

    `slots`: the number of slots; None for the number of steps.
    """
    slots = intervals * steps if slots is None else slots
    index = xp.minimum(np.arange(slots), intervals * steps - 1)
    position = xp.where(np.arange(slots) < intervals * steps, index % steps, steps)
    return Mesh(
        interval=(index // steps).astype(np.int32),
        start=position / steps,
        end=xp.minimum(position + 1, steps) / steps,
        count=xp.asarray(intervals * steps, np.int32),
    )


def first_mesh(intervals: int, slots: int | None = None) -> Mesh:
    """Return the initial mesh, with output intervals halved until there are `MIN_STEPS` steps or the slots are full."""
    steps = 1
    while intervals * steps < MIN_STEPS and (slots is None or 2 * intervals * steps <= slots):
        steps *= 2
    return uniform(intervals, steps, slots)


def padded(mesh: Mesh, slots: int) -> Mesh:
    """Return a mesh of NumPy arrays with empty slots added, so that there are `slots` slots."""
    more = slots - len(mesh.start)
    return Mesh(
        xp.pad(mesh.interval, (0, more), mode="edge"),
        xp.pad(mesh.start, (0, more), constant_values=1.0),
        xp.pad(mesh.end, (0, more), constant_values=1.0),
        mesh.count,
    )


def on_device(mesh: Mesh, dtype: Any) -> Mesh:
    """Return a mesh of JAX arrays, with fractions in `dtype`."""
    return Mesh(
        jnp.asarray(mesh.interval),
        jnp.asarray(mesh.start, dtype),
        jnp.asarray(mesh.end, dtype),
        jnp.asarray(mesh.count),
    )


def spans(mesh: Mesh, times: Float[Array, " m"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return the start and the length [s] of each step; both are differentiable with respect to the output times."""
    origin = times[mesh.interval]
    length = xp.diff(times)[mesh.interval]
    return origin + mesh.start * length, (mesh.end - mesh.start) * length


def estimate_nodes(method: AbstractIncrement) -> Any:
    """Return the nodes (4s+1,) on [0, 1] at which `estimate` needs the rate, for a method with s nodes.

    The result contains the nodes of the step, the nodes of its two halves, and the Lobatto nodes, which include both
    ends. Without the ends, a jump between the last node and the end of a step would be missed.
    """
    c = method.nodes
    return np.concatenate([c, 0.5 * c, 0.5 + 0.5 * c, lobatto(len(c) + 1)[0]])


def instants(start: Float[Array, " n"], h: Float[Array, " n"], nodes: Float[Array, " s"]) -> Float[Array, "n s"]:
    """Return the instants [s] of the `nodes` of steps that start at `start` and last `h` [s].

    An instant at the end of a step is moved before the end, because the rate may jump there.
    """
    end = start + h
    before = xp.maximum(start, end - 4 * float(np.finfo(h.dtype).eps) * abs(end))
    return xp.minimum(start[:, None] + h[:, None] * constant(nodes, h)[None], before[:, None])


class StepErrors(eqx.Module):
    """The error estimate `step` (n,) [rad] of each step, and the part `noise` (n,) [rad] that round-off can cause."""

    step: Float[Array, " n"]
    noise: Float[Array, " n"]


class Errors(eqx.Module):
    """The error estimates [rad] of a mesh.

    `step` (n,): the error of each step. `floor` (n,): the error below which the estimate may consist of round-off.
    Rotations are multiplied, so the total error is at most the sum of the errors. `truncation`: the sum of those errors
    that exceed their `floor`; NaN if a rate is not finite. `bound`: the sum of all errors and the round-off of the
    result.
    """

    step: Float[Array, " n"]
    floor: Float[Array, " n"]
    truncation: Scalar
    bound: Scalar


def step_errors(
    method: AbstractIncrement, rates: Float[Array, "n m k"], start: Float[Array, " n"], h: Float[Array, " n"]
) -> StepErrors:
    """Estimate the errors of steps from the rates at `estimate_nodes`; the estimates are not differentiated.

    The error of a step is the larger of two differences: between the step and its two halves, and between Gauss and
    Lobatto quadrature of the rate. The error of ½∫ω0 is added as if it were an angle.
    """
    rates, start, h = stop_gradient((rates, start, h))
    n, s = h.shape[0], len(method.nodes)
    nodes = rates[:, : 3 * s].reshape(3 * n, s, rates.shape[2])  # whole step, first half, second half
    widths = (h[:, None] * constant([[1.0, 0.5, 0.5]], h)).reshape(3 * n)
    rotations, log_scales = increments(method, nodes, widths)
    rotations, log_scales = rotations.reshape(n, 3, 4), log_scales.reshape(n, 3)
    halves = quaternion.product(rotations[:, 1], rotations[:, 2])
    between = quaternion.product(quaternion.conjugate(rotations[:, 0]), halves)
    angle = 2 * norm(between[:, 1:])  # from the vector part, so that round-off is relative to the angle
    log_scale = abs(log_scales[:, 0] - log_scales[:, 1] - log_scales[:, 2])
    weights = np.concatenate([method.weights, -lobatto(s + 1)[1]])
    quadrature_rates = xp.concatenate([rates[:, :s], rates[:, 3 * s :]], axis=1)
    integral = h[:, None] * matmul(constant(weights, h), quadrature_rates)
    angle = xp.maximum(angle, norm(integral[:, -3:]))
    log_scale = xp.maximum(log_scale, 0.5 * xp.sum(abs(integral[:, :-3]), axis=1))
    return StepErrors(angle + log_scale, _round_off(rates, start, h))


def total_errors(errors: StepErrors, count: Int[Array, ""]) -> Errors:
    """Return the errors of a mesh with `count` steps."""
    step, floor = errors.step, ROUND_OFF * errors.noise
    truncation = xp.sum(xp.where(step <= floor, 0.0, step))
    # The rounding errors of the products are independent, so their sum grows with the square root of the count.
    products = float(np.finfo(step.dtype).eps) * xp.sqrt(count.astype(step.dtype))
    return Errors(step, floor, truncation, xp.sum(step) + 4 * (products + xp.sum(errors.noise)))


def _round_off(rates: Float[Array, "n m k"], start: Float[Array, " n"], h: Float[Array, " n"]) -> Float[Array, " n"]:
    """Estimate the round-off [rad] of each step, caused by the arithmetic and by the rounding of the times."""
    angle = h * xp.max(abs(rates), axis=(1, 2))
    change = xp.max(xp.max(rates, axis=1) - xp.min(rates, axis=1), axis=1)
    return float(np.finfo(h.dtype).eps) * (angle + abs(start) * change / ROUND_OFF)


def pieces(mesh: Mesh, errors: Errors, tolerance: Scalar, order: int) -> Int[Array, " n"]:
    """Return the number of equal parts into which each step must be split; 0 for empty slots.

    A step is split if its error is above its `floor` and above the tolerance divided by the number of steps.
    """
    error = errors.step
    share = tolerance / mesh.count.astype(error.dtype)
    tiny = float(np.finfo(error.dtype).tiny)
    levels = xp.log2(xp.maximum(error, tiny) / xp.maximum(share, tiny)) / (order + 1)
    halvings = xp.clip(xp.ceil(levels), 1, MAX_HALVINGS).astype(np.int32)
    split = mesh.used & (error > errors.floor) & (error > share)
    return xp.where(mesh.used, xp.where(split, 2**halvings, 1), 0)


def split_steps(mesh: Mesh, parts: Int[Array, " n"], slots: int) -> tuple[Mesh, Int[Array, " slots"]]:
    """Split each step into `parts` (n,) equal steps; return the new mesh, and the old step of each new step.

    If there are fewer than `slots` new steps, the other slots are empty.
    """
    ends = xp.cumsum(parts)
    needed = ends[-1].astype(np.int32)
    slot = np.arange(slots, dtype=np.int32)
    parent = xp.minimum(xp.searchsorted(ends, slot, side="right").astype(np.int32), mesh.count - 1)
    used = slot < needed
    start, width = mesh.start[parent], (mesh.end - mesh.start)[parent] / parts[parent].astype(mesh.start.dtype)
    piece = (slot - (ends - parts)[parent]).astype(mesh.start.dtype)
    finer = Mesh(
        mesh.interval[parent],
        xp.where(used, start + piece * width, 1.0),
        xp.where(used, start + (piece + 1) * width, 1.0),
        needed,
    )
    return finer, parent


def refine(mesh: Mesh, errors: Errors, tolerance: Scalar, order: int) -> tuple[Mesh, Int[Array, ""]]:
    """Split the steps with large errors inside a trace, where the number of slots is fixed.

    Return the mesh and the required number of steps. If the mesh has fewer slots than this number, it is returned
    unchanged.
    """
    slots = mesh.start.shape[0]
    finer, _ = split_steps(mesh, pieces(mesh, errors, tolerance, order), slots)
    fits = finer.count <= slots
    return jax.tree.map(lambda new, old: jnp.where(fits, new, old), finer, mesh), finer.count


def last_steps(mesh: Mesh, intervals: int) -> Int[Array, " intervals"]:
    """Return the index of the last step of each output interval."""
    numbers = np.arange(intervals, dtype=np.int32)
    last = xp.searchsorted(mesh.interval, numbers, side="right").astype(np.int32) - 1
    return xp.minimum(last, mesh.count - 1)  # empty slots belong to the last interval
