"""The limits on a path as inequality rows: each at its highest peaks in time, with derivatives in the variables.

A row is g(z, u) = ½((value/limit)² − 1) ≤ 0 at a fraction u of the duration. At an inner peak u moves with z so that
∂g/∂u = 0: the gradient of the peak is ∂g/∂z (envelope theorem), its Hessian g_zz − g_zu g_uz/g_uu. At an end it stands
still. Fixed times between them, with gradients alone, foretell the peaks that a step would raise.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from qtraj.design.limits import Limits
from qtraj.design.magnitudes import PER_TIME, squared
from qtraj.design.peaks import climb, highest
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.foundation.types import Scalar

NODES = 65
"""Times at which peaks are sought."""

STRIDE = 4
"""Every so many nodes one is a fixed time, with a row of its own."""

ALWAYS = 3
"""Peaks that are always sought: next to both ends, and where the path is slowest."""

ABSENT = -1e3
"""The value of a row for a peak that is not there."""

TOO_MUCH = 1e9
"""The value of a row that is not finite."""

NEWTON_STEPS = 3
REACH = 1 / (NODES - 1)  # so far from a node its peak is sought
FOLLOWED = 0.1  # of the duration: so far a peak is followed through one step
SAME = 1e-5  # of the duration: peaks nearer to each other are one


class Rows(NamedTuple):
    """Rows, limit after limit: values, gradients, and where they stand, as fractions of the duration."""

    value: Float[Array, " m"]
    slope: Float[Array, "m n"]
    time: Float[Array, " m"]
    moving: Bool[Array, " m"]  # with a peak, or else standing still


class Peaks(NamedTuple):
    """Where the peaks and ends of all limits stand, and which of them there are."""

    time: Float[Array, "limits k"]
    present: Bool[Array, "limits k"]
    moving: Bool[Array, "limits k"]  # an inner peak, whose time changes with the variables


def peaks_of_each(limits: Limits) -> int:
    """How many peaks of each limit become rows: fewer of each where there are more limits."""
    return {1: 4, 2: 3}.get(len(limits.given()), 2)


def find_peaks(problem: Problem, limits: Limits, z: Variables) -> Peaks:
    """The peaks and ends of all limits at `z`."""
    number = peaks_of_each(limits)
    slow = _slowest(problem, z)
    found = [_peaks(problem, z, name, limit, number, slow) for name, limit in limits.given().items()]
    return Peaks(*(jnp.stack(column) for column in zip(*found, strict=True)))


def values_at(problem: Problem, limits: Limits, z: Variables, peaks: Peaks) -> Float[Array, "limits k"]:
    """The values at peaks and ends."""

    def of(name: str, limit: Scalar, times: Float[Array, " k"]) -> Float[Array, " k"]:
        return jax.vmap(lambda u: excess(problem, z, u, name, limit))(times)

    values = jnp.stack([of(name, limit, peaks.time[k]) for k, (name, limit) in enumerate(limits.given().items())])
    return jnp.where(peaks.present, jnp.where(jnp.isfinite(values), values, TOO_MUCH), ABSENT)


def values_nearby(problem: Problem, limits: Limits, z: Variables, rows: Rows) -> Float[Array, " m"]:
    """The values at `z` of rows that stand elsewhere, their peaks followed to where they are; absent ones stay so."""
    given = limits.given()
    times, moving = (x.reshape(len(given), -1) for x in (rows.time, rows.moving))
    number = peaks_of_each(limits) + ALWAYS
    values = []
    for k, (name, limit) in enumerate(given.items()):
        g = _at_path(problem, z, name, limit)
        peaks = times[k, :number]
        followed, _ = _polished(g, peaks, jnp.where(moving[k, :number], FOLLOWED, REACH))
        values.append(jax.vmap(g)(jnp.concatenate([followed, times[k, number:]])))
    flat = 0.5 * (jnp.concatenate(values) - 1.0)
    return jnp.where(rows.value > ABSENT, jnp.where(jnp.isfinite(flat), flat, rows.value), ABSENT)


def rows_at(problem: Problem, limits: Limits, z: Variables, peaks: Peaks) -> tuple[Rows, Float[Array, "limits k n n"]]:
    """All rows of all limits at `z`, peaks and ends before fixed times, and the Hessians of peaks and ends."""
    fixed = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)[STRIDE:-1:STRIDE]
    rows, hessians = [], []
    for k, (name, limit) in enumerate(limits.given().items()):
        highest, hessian = _highest(problem, z, name, limit, jax.tree.map(lambda x, k=k: x[k], peaks))
        rows += [highest, _fixed(problem, z, name, limit, fixed)]
        hessians.append(hessian)
    return Rows(*(jnp.concatenate(field) for field in zip(*rows, strict=True))), jnp.stack(hessians)


def excess(problem: Problem, z: Variables, u: Scalar, name: str, limit: Scalar) -> Scalar:
    """g = ½((value/limit)² − 1) at the fraction `u` of the duration."""
    return 0.5 * (_at_path(problem, z, name, limit)(u) - 1.0)


def _highest(
    problem: Problem, z: Variables, name: str, limit: Scalar, peaks: Peaks
) -> tuple[Rows, Float[Array, "k n n"]]:
    """The rows of one limit's peaks and ends, and their Hessians."""
    u, present, moves = peaks

    def g(z: Variables, u: Scalar) -> Scalar:
        return excess(problem, z, u, name, limit)

    def at(u: Scalar) -> tuple[Array, ...]:
        def pair(u: Scalar) -> tuple[Scalar, Variables]:
            return jax.value_and_grad(g)(z, u)

        one = jnp.ones_like(u)
        (value, slope), (_, mixed) = jax.jvp(pair, (u,), (one,))
        bend = jax.jvp(lambda u: jax.jvp(lambda u: g(z, u), (u,), (one,))[1], (u,), (one,))[1]
        return value, slope, mixed, bend, jax.hessian(g)(z, u)

    value, slope, mixed, bend, hessian = jax.vmap(at)(u)
    bends = moves & (bend < 0)
    moving = jnp.where(bends, 1 / jnp.where(bends, bend, 1.0), 0.0)
    curvature = hessian - moving[:, None, None] * mixed[:, :, None] * mixed[:, None, :]
    sound = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), 1) & jnp.all(jnp.isfinite(curvature), (1, 2))
    height = jnp.where(present, jnp.where(sound, value, TOO_MUCH), ABSENT)
    kept = present & sound
    return Rows(height, _keep(slope, kept[:, None]), u, moves), _keep(curvature, kept[:, None, None])


def _fixed(problem: Problem, z: Variables, name: str, limit: Scalar, times: Float[Array, " r"]) -> Rows:
    """The rows of one limit at fixed times."""
    value, slope = jax.vmap(jax.value_and_grad(lambda z, u: excess(problem, z, u, name, limit)), (None, 0))(z, times)
    sound = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), 1)
    return Rows(jnp.where(sound, value, ABSENT), _keep(slope, sound[:, None]), times, jnp.zeros(times.shape, bool))


def _keep(x: Array, keep: Array) -> Array:
    return jnp.where(keep, x, jnp.zeros_like(x))


def _at_path(problem: Problem, z: Variables, name: str, limit: Scalar) -> Callable[[Scalar], Scalar]:
    """(value/limit)² of the path of `z`, in unit time: simpler to differentiate, and the limit is scaled instead."""
    path = problem.unit_path(z)
    scaled = limit * problem.time(z) ** PER_TIME[name]
    return lambda u: squared(path, u, name) / scaled**2


def _peaks(
    problem: Problem, z: Variables, name: str, limit: Scalar, peaks: int, slow: Scalar
) -> tuple[Float[Array, " k"], Bool[Array, " k"], Bool[Array, " k"]]:
    """The highest inner local maxima over the nodes, those next to both ends and to `slow`; which there are and move.

    Where a path nearly stops its curvature may rise to a needle between the nodes: it stands where the speed, which is
    smooth, is least.
    """
    g = _at_path(problem, z, name, limit)
    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)
    picked, present = _highest_nodes(jax.vmap(g)(nodes), nodes, peaks)
    u = jnp.concatenate([picked, jnp.stack([slow, jnp.zeros_like(slow), jnp.ones_like(slow)])])
    times, moving = _polished(g, u, REACH)
    present = jnp.concatenate([present, jnp.ones(ALWAYS, bool)])
    return times, present & ~_repeated(times, present), moving


def _polished(
    g: Callable[[Scalar], Scalar], u: Float[Array, " k"], reach: ArrayLike
) -> tuple[Float[Array, " k"], Bool[Array, " k"]]:
    """The peaks within `reach` of the times, and which there are; where there is none a time stays as it is."""
    low, high = jnp.maximum(u - reach, 0.0), jnp.minimum(u + reach, 1.0)
    found = climb(g, u, low, high, NEWTON_STEPS)
    inside = (found > low) & (found < high)
    return jnp.where(inside, found, u), inside


def _repeated(times: Float[Array, " k"], present: Bool[Array, " k"]) -> Bool[Array, " k"]:
    """Which times are those of an earlier peak: one row for each, or their multipliers are not unique."""
    k = times.shape[0]
    earlier = jnp.arange(k)[None] < jnp.arange(k)[:, None]
    return jnp.any(earlier & present[None] & (jnp.abs(times[None] - times[:, None]) < SAME), axis=1)


def _slowest(problem: Problem, z: Variables) -> Scalar:
    """Where the speed is least: the lowest of its inner local minima over the nodes, polished."""
    path = problem.unit_path(z)

    def slowness(u: Scalar) -> Scalar:
        return -squared(path, u, "speed")

    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)
    picked, _ = _highest_nodes(jax.vmap(slowness)(nodes), nodes, 1)
    return climb(slowness, picked, picked - REACH, picked + REACH, NEWTON_STEPS)[0]


def _highest_nodes(
    values: Float[Array, " nodes"], nodes: Float[Array, " nodes"], number: int
) -> tuple[Float[Array, " number"], Bool[Array, " number"]]:
    """The inner nodes of the highest local maxima, and which of them there are."""
    middle = values[1:-1]
    heights = jnp.where((middle >= values[:-2]) & (middle > values[2:]), middle, -jnp.inf)
    places = highest(heights, number)
    return nodes[places + 1], heights[places] > -jnp.inf
