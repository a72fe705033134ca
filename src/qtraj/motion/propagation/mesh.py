"""Construct the steps of a propagation: the mesh between the output times, error estimates, and refinement.

The same functions are used outside a trace, where a mesh may grow, and inside a trace, where the number of slots is
fixed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra import quaternion
from qtraj.foundation.types import Scalar
from qtraj.motion.propagation.gauss_legendre import lobatto
from qtraj.motion.propagation.increment import AbstractIncrement, exact_product, increments

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
        return jnp.arange(self.start.shape[0], dtype=jnp.int32) < self.count


def uniform(intervals: int, steps: int, slots: int, dtype: jnp.dtype) -> Mesh:
    """Return a mesh with `slots` slots and `steps` equal steps in each of `intervals` output intervals."""
    index = np.minimum(np.arange(slots), intervals * steps - 1)
    position = np.where(np.arange(slots) < intervals * steps, index % steps, steps)
    return Mesh(
        interval=jnp.asarray(index // steps, jnp.int32),
        start=jnp.asarray(position / steps, dtype),
        end=jnp.asarray(np.minimum(position + 1, steps) / steps, dtype),
        count=jnp.asarray(intervals * steps, jnp.int32),
    )


def first_mesh(intervals: int, slots: int, dtype: jnp.dtype) -> Mesh:
    """Return the initial mesh, with output intervals halved until there are `MIN_STEPS` steps or the slots are full."""
    steps = 1
    while intervals * steps < MIN_STEPS and 2 * intervals * steps <= slots:
        steps *= 2
    return uniform(intervals, steps, slots, dtype)


def resized(mesh: Mesh, slots: int) -> Mesh:
    """Return the mesh with `slots` slots, after adding or removing empty slots."""
    size = mesh.start.shape[0]
    if slots <= size:
        return Mesh(mesh.interval[:slots], mesh.start[:slots], mesh.end[:slots], mesh.count)
    more = slots - size
    full = jnp.ones_like(mesh.end, shape=more)
    return Mesh(
        jnp.concatenate([mesh.interval, jnp.full_like(mesh.interval, mesh.interval[-1], shape=more)]),
        jnp.concatenate([mesh.start, full]),
        jnp.concatenate([mesh.end, full]),
        mesh.count,
    )


def spans(mesh: Mesh, times: Float[Array, " m"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return the start and the length [s] of each step; both are differentiable with respect to the output times."""
    origin = times[mesh.interval]
    length = jnp.diff(times)[mesh.interval]
    return origin + mesh.start * length, (mesh.end - mesh.start) * length


def estimate_nodes(method: AbstractIncrement) -> np.ndarray:
    """Return the nodes (4s+1,) on [0, 1] at which `estimate` needs the rate, for a method with s nodes.

    The result contains the nodes of the step, the nodes of its two halves, and the Lobatto nodes, which include both
    ends. Without the ends, a jump between the last node and the end of a step would be missed.
    """
    c = method.nodes
    return np.concatenate([c, 0.5 * c, 0.5 + 0.5 * c, lobatto(len(c) + 1)[0]])


class SampledRates(eqx.Module):
    """The rates [rad/s] at the nodes of each step, with the start and the length `h` [s] of each step.

    The axes of `rates` (n, m, k) are steps, nodes and components.
    """

    rates: Float[Array, "n m k"]
    start: Float[Array, " n"]
    h: Float[Array, " n"]


class Errors(eqx.Module):
    """The error estimates [rad] of the steps of a mesh.

    `step` (n,): the error of each step. `floor` (n,): the error below which the estimate may consist of round-off.
    Rotations are multiplied, so the total error is at most the sum of the errors. `truncation`: the sum of those errors
    that exceed their `floor`; NaN if a rate is not finite. `bound`: the sum of all errors and the round-off of the
    result.
    """

    step: Float[Array, " n"]
    floor: Float[Array, " n"]
    truncation: Scalar
    bound: Scalar


def estimate(method: AbstractIncrement, sampled: SampledRates, count: Int[Array, ""]) -> Errors:
    """Estimate the errors of `count` steps from the rates at `estimate_nodes`.

    The error of a step is the larger of two differences: between the step and its two halves, and between Gauss and
    Lobatto quadrature of the rate. The error of ½∫ω0 is added as if it were an angle.
    """
    rates, start, h = stop_gradient((sampled.rates, sampled.start, sampled.h))
    n, s = h.shape[0], len(method.nodes)
    nodes = rates[:, : 3 * s].reshape(3 * n, s, rates.shape[2])  # whole step, first half, second half
    widths = jnp.outer(h, jnp.asarray([1.0, 0.5, 0.5], h.dtype)).reshape(3 * n)
    rotations, log_scales = increments(method, nodes, widths)
    rotations, log_scales = rotations.reshape(n, 3, 4), log_scales.reshape(n, 3)
    halves = jax.vmap(quaternion.product)(rotations[:, 1], rotations[:, 2])
    between = jax.vmap(quaternion.product)(jax.vmap(quaternion.conjugate)(rotations[:, 0]), halves)
    angle = 2 * jnp.sqrt(
        jnp.sum(between[:, 1:] ** 2, axis=1)
    )  # from the vector part, so that round-off is relative to the angle
    log_scale = jnp.abs(log_scales[:, 0] - log_scales[:, 1] - log_scales[:, 2])
    weights = np.concatenate([method.weights, -lobatto(s + 1)[1]])
    quadrature_rates = jnp.concatenate([rates[:, :s], rates[:, 3 * s :]], axis=1)
    integral = h[:, None] * exact_product(jnp.asarray(weights, h.dtype), quadrature_rates)
    angle = jnp.maximum(angle, jnp.sqrt(jnp.sum(integral[:, -3:] ** 2, axis=1)))
    log_scale = jnp.maximum(log_scale, 0.5 * jnp.sum(jnp.abs(integral[:, :-3]), axis=1))
    step, noise = angle + log_scale, _round_off(rates, start, h)
    floor = ROUND_OFF * noise
    truncation = jnp.sum(jnp.where(step <= floor, 0.0, step))
    # The rounding errors of the products are independent, so their sum grows with the square root of the count.
    products = float(jnp.finfo(h.dtype).eps) * jnp.sqrt(count.astype(h.dtype))
    return Errors(step, floor, truncation, jnp.sum(step) + 4 * (products + jnp.sum(noise)))


def _round_off(rates: Float[Array, "n m k"], start: Float[Array, " n"], h: Float[Array, " n"]) -> Float[Array, " n"]:
    """Estimate the round-off [rad] of each step, caused by the arithmetic and by the rounding of the times."""
    angle = h * jnp.max(jnp.abs(rates), axis=(1, 2))
    change = jnp.max(jnp.max(rates, axis=1) - jnp.min(rates, axis=1), axis=1)
    return float(jnp.finfo(h.dtype).eps) * (angle + jnp.abs(start) * change / ROUND_OFF)


def padded(errors: Errors, slots: int) -> Errors:
    """Return the errors, padded with zeros to `slots` slots."""
    more = (0, slots - errors.step.shape[0])
    return Errors(jnp.pad(errors.step, more), jnp.pad(errors.floor, more), errors.truncation, errors.bound)


def refine(mesh: Mesh, errors: Errors, tolerance: Scalar, order: int) -> tuple[Mesh, Int[Array, ""]]:
    """Split every step with an error above its `floor` and above the tolerance divided by the number of steps.

    Return the mesh and the required number of steps. If the mesh has fewer slots than this number, it is returned
    unchanged.
    """
    error = errors.step
    share = tolerance / mesh.count.astype(error.dtype)
    tiny = float(jnp.finfo(error.dtype).tiny)
    levels = jnp.log2(jnp.maximum(error, tiny) / jnp.maximum(share, tiny)) / (order + 1)
    halvings = jnp.clip(jnp.ceil(levels), 1, MAX_HALVINGS).astype(jnp.int32)
    split = mesh.used & (error > errors.floor) & (error > share)
    pieces = jnp.where(mesh.used, jnp.where(split, 2**halvings, 1), 0)
    ends = jnp.cumsum(pieces)
    needed = ends[-1]
    slot = jnp.arange(pieces.shape[0], dtype=jnp.int32)
    parent = jnp.minimum(jnp.searchsorted(ends, slot, side="right").astype(jnp.int32), mesh.count - 1)
    used = slot < needed
    start, width = mesh.start[parent], (mesh.end - mesh.start)[parent] / pieces[parent].astype(error.dtype)
    piece = (slot - (ends - pieces)[parent]).astype(error.dtype)
    finer = Mesh(
        mesh.interval[parent],
        jnp.where(used, start + piece * width, 1.0),
        jnp.where(used, start + (piece + 1) * width, 1.0),
        needed,
    )
    fits = needed <= slot.shape[0]
    return jax.tree.map(lambda new, old: jnp.where(fits, new, old), finer, mesh), needed


def last_steps(mesh: Mesh, intervals: int) -> Int[Array, " intervals"]:
    """Return the index of the last step of each output interval."""
    sizes = jnp.zeros(intervals, jnp.int32).at[mesh.interval].add(mesh.used.astype(jnp.int32))
    return jnp.cumsum(sizes) - 1
