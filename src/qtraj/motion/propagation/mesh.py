"""Steps of a propagation: where they lie between the output times, how good they are, and which of them to split.

The same functions plan outside a trace, where a mesh may grow, and inside, where its number of slots is fixed.
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

FEWEST_STEPS = 8
"""A propagation starts from at least so many steps, so that a short event between few nodes is not overlooked."""

ROUND_OFF = 8
"""Roundings: an estimate below so many is round-off, and splitting the step would not lower it."""

MOST_HALVINGS = 3
"""A step is split into at most 2³ at a time."""


class Mesh(eqx.Module):
    """Steps in order of time: step j runs from `start` to `end` (n,), as parts of output interval `interval` (n,).

    Splits are dyadic, so these parts are exact. Slots from `count` on are empty steps at the end of the last interval.
    """

    interval: Int[Array, " n"]
    start: Float[Array, " n"]
    end: Float[Array, " n"]
    count: Int[Array, ""]

    @property
    def used(self) -> Bool[Array, " n"]:
        return jnp.arange(self.start.shape[0], dtype=jnp.int32) < self.count


def uniform(intervals: int, steps: int, slots: int, dtype: jnp.dtype) -> Mesh:
    """`steps` equal steps in each interval."""
    index = np.minimum(np.arange(slots), intervals * steps - 1)
    part = np.where(np.arange(slots) < intervals * steps, index % steps, steps)
    return Mesh(
        interval=jnp.asarray(index // steps, jnp.int32),
        start=jnp.asarray(part / steps, dtype),
        end=jnp.asarray(np.minimum(part + 1, steps) / steps, dtype),
        count=jnp.asarray(intervals * steps, jnp.int32),
    )


def first_mesh(intervals: int, slots: int, dtype: jnp.dtype) -> Mesh:
    """The mesh a search starts from: the output intervals, halved until there are `FEWEST_STEPS`."""
    steps = 1
    while intervals * steps < FEWEST_STEPS and 2 * intervals * steps <= slots:
        steps *= 2
    return uniform(intervals, steps, slots, dtype)


def resized(mesh: Mesh, slots: int) -> Mesh:
    """The same steps with more or fewer empty slots."""
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
    """First instant and length of each step [s]; both follow a change of the output times."""
    origin = times[mesh.interval]
    length = jnp.diff(times)[mesh.interval]
    return origin + mesh.start * length, (mesh.end - mesh.start) * length


def estimate_nodes(method: AbstractIncrement) -> np.ndarray:
    """Where `estimate` wants the rate, as parts of a step (4s+1,): at the nodes of the step, of its halves, and at
    Lobatto's, which include the ends. Without these a jump could hide between the last node and the end of a step."""
    c = method.nodes
    return np.concatenate([c, 0.5 * c, 0.5 + 0.5 * c, lobatto(len(c) + 1)[0]])


class Taken(eqx.Module):
    """The rates [rad/s] at the nodes of each step, its first instant and its length [s]."""

    rates: Float[Array, "n m k"]
    start: Float[Array, " n"]
    h: Float[Array, " n"]


class Errors(eqx.Module):
    """How wrong the steps of a mesh are [rad].

    `step` (n,): error of each; `floor` (n,): where it may be round-off. For the whole, since turns compose and their
    errors at most add up: `truncation`, the sum of what is no round-off, NaN for a rate that is not finite; `bound`,
    the sum of all, with the round-off of the result.
    """

    step: Float[Array, " n"]
    floor: Float[Array, " n"]
    truncation: Scalar
    bound: Scalar


def estimate(method: AbstractIncrement, taken: Taken, count: Int[Array, ""]) -> Errors:
    """The errors of `count` steps from the rates at `estimate_nodes`.

    The larger of two differences counts: the step against its two halves, and the integrals of the rate by Gauss's and
    Lobatto's rules. An error in the growth ½∫ω0 is added like an angle.
    """
    rates, start, h = stop_gradient((taken.rates, taken.start, taken.h))
    n, s = h.shape[0], len(method.nodes)
    parts = rates[:, : 3 * s].reshape(3 * n, s, rates.shape[2])  # whole, first half, second half of each step
    widths = jnp.outer(h, jnp.asarray([1.0, 0.5, 0.5], h.dtype)).reshape(3 * n)
    turns, growths = increments(method, parts, widths)
    turns, growths = turns.reshape(n, 3, 4), growths.reshape(n, 3)
    halves = jax.vmap(quaternion.product)(turns[:, 1], turns[:, 2])
    between = jax.vmap(quaternion.product)(jax.vmap(quaternion.conjugate)(turns[:, 0]), halves)
    angle = 2 * jnp.sqrt(jnp.sum(between[:, 1:] ** 2, axis=1))  # round-off here is that of the turn, not of 1
    growth = jnp.abs(growths[:, 0] - growths[:, 1] - growths[:, 2])
    weights = np.concatenate([method.weights, -lobatto(s + 1)[1]])
    sampled = jnp.concatenate([rates[:, :s], rates[:, 3 * s :]], axis=1)
    integral = h[:, None] * exact_product(jnp.asarray(weights, h.dtype), sampled)
    angle = jnp.maximum(angle, jnp.sqrt(jnp.sum(integral[:, -3:] ** 2, axis=1)))
    growth = jnp.maximum(growth, 0.5 * jnp.sum(jnp.abs(integral[:, :-3]), axis=1))
    step, noise = angle + growth, _noise(rates, start, h)
    floor = ROUND_OFF * noise
    truncation = jnp.sum(jnp.where(step <= floor, 0.0, step))
    products = float(jnp.finfo(h.dtype).eps) * jnp.sqrt(count.astype(h.dtype))  # their roundings are independent
    return Errors(step, floor, truncation, jnp.sum(step) + 4 * (products + jnp.sum(noise)))


def _noise(rates: Float[Array, "n m k"], start: Float[Array, " n"], h: Float[Array, " n"]) -> Float[Array, " n"]:
    """Round-off of the turn in each step: of the arithmetic, and of the one rounding of each time [rad]."""
    turn = h * jnp.max(jnp.abs(rates), axis=(1, 2))
    change = jnp.max(jnp.max(rates, axis=1) - jnp.min(rates, axis=1), axis=1)
    return float(jnp.finfo(h.dtype).eps) * (turn + jnp.abs(start) * change / ROUND_OFF)


def padded(errors: Errors, slots: int) -> Errors:
    """The errors of the same steps with more empty slots."""
    more = (0, slots - errors.step.shape[0])
    return Errors(jnp.pad(errors.step, more), jnp.pad(errors.floor, more), errors.truncation, errors.bound)


def refine(mesh: Mesh, errors: Errors, tolerance: Scalar, order: int) -> tuple[Mesh, Int[Array, ""]]:
    """The mesh with every step split that takes more than its equal share of the tolerance, and the steps wanted.

    More steps may be wanted than there are slots: then the mesh is as it was.
    """
    error = errors.step
    share = tolerance / mesh.count.astype(error.dtype)
    tiny = float(jnp.finfo(error.dtype).tiny)
    excess = jnp.log2(jnp.maximum(error, tiny) / jnp.maximum(share, tiny)) / (order + 1)
    halvings = jnp.clip(jnp.ceil(excess), 1, MOST_HALVINGS).astype(jnp.int32)
    split = mesh.used & (error > errors.floor) & (error > share)
    pieces = jnp.where(mesh.used, jnp.where(split, 2**halvings, 1), 0)
    ends = jnp.cumsum(pieces)
    wanted = ends[-1]
    slot = jnp.arange(pieces.shape[0], dtype=jnp.int32)
    parent = jnp.minimum(jnp.searchsorted(ends, slot, side="right").astype(jnp.int32), mesh.count - 1)
    used = slot < wanted
    start, width = mesh.start[parent], (mesh.end - mesh.start)[parent] / pieces[parent].astype(error.dtype)
    piece = (slot - (ends - pieces)[parent]).astype(error.dtype)
    finer = Mesh(
        mesh.interval[parent],
        jnp.where(used, start + piece * width, 1.0),
        jnp.where(used, start + (piece + 1) * width, 1.0),
        wanted,
    )
    fits = wanted <= slot.shape[0]
    return jax.tree.map(lambda new, old: jnp.where(fits, new, old), finer, mesh), wanted


def last_steps(mesh: Mesh, intervals: int) -> Int[Array, " intervals"]:
    """The step that ends each output interval."""
    sizes = jnp.zeros(intervals, jnp.int32).at[mesh.interval].add(mesh.used.astype(jnp.int32))
    return jnp.cumsum(sizes) - 1
