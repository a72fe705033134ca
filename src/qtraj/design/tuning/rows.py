"""The limits on a path as inequality rows: each at its highest peaks in time, with derivatives in the variables.

A row is g(z, u) = ½((value/limit)² − 1) ≤ 0 at a fraction u of the duration. At an inner peak u moves with z so that
∂g/∂u = 0: the gradient of the peak is ∂g/∂z (envelope theorem), its Hessian g_zz − g_zu g_uz/g_uu. At an end it stands
still. Fixed times between them, with gradients alone, foretell the peaks that a step would raise.

The course of the path, the few numbers that make it up, is differentiated in z once for all rows.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from qtraj.design.limits import Limits
from qtraj.design.peaks import climb, highest
from qtraj.design.tuning.excess import Excess, Moves, in_a_row
from qtraj.design.tuning.problem import Course, Problem, Variables
from qtraj.foundation.derivatives import with_derivatives
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
    course = problem.course(z)
    slow = _slowest(problem, course)
    excesses = [partial(Excess(problem, name, limit), course) for name, limit in limits.given().items()]
    found = [_peaks(g, number, slow) for g in excesses]
    return Peaks(*(jnp.stack(column) for column in zip(*found, strict=True)))


def values_at(problem: Problem, limits: Limits, z: Variables, peaks: Peaks) -> Float[Array, "limits k"]:
    """The values at peaks and ends."""
    course = problem.course(z)

    def of(name: str, limit: Scalar, times: Float[Array, " k"]) -> Float[Array, " k"]:
        return jax.vmap(partial(Excess(problem, name, limit), course))(times)

    values = jnp.stack([of(name, limit, peaks.time[k]) for k, (name, limit) in enumerate(limits.given().items())])
    return jnp.where(peaks.present, jnp.where(jnp.isfinite(values), values, TOO_MUCH), ABSENT)


def values_nearby(problem: Problem, limits: Limits, z: Variables, rows: Rows) -> Float[Array, " m"]:
    """The values at `z` of rows that stand elsewhere, their peaks followed to where they are; absent ones stay so."""
    given, course = limits.given(), problem.course(z)
    times, moving = (x.reshape(len(given), -1) for x in (rows.time, rows.moving))
    number = peaks_of_each(limits) + ALWAYS
    values = []
    for k, (name, limit) in enumerate(given.items()):
        g = partial(Excess(problem, name, limit), course)
        peaks = times[k, :number]
        followed, _ = _polished(g, peaks, jnp.where(moving[k, :number], FOLLOWED, REACH))
        values.append(jax.vmap(g)(jnp.concatenate([followed, times[k, number:]])))
    flat = jnp.concatenate(values)
    return jnp.where(rows.value > ABSENT, jnp.where(jnp.isfinite(flat), flat, rows.value), ABSENT)


def rows_at(problem: Problem, limits: Limits, z: Variables, peaks: Peaks) -> tuple[Rows, Float[Array, "limits k n n"]]:
    """All rows of all limits at `z`, peaks and ends before fixed times, and the Hessians of peaks and ends."""
    fixed = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)[STRIDE:-1:STRIDE]
    moves = _moves(problem, z)
    rows, hessians = [], []
    for k, (name, limit) in enumerate(limits.given().items()):
        g = Excess(problem, name, limit)
        highest, hessian = _highest(g, moves, jax.tree.map(lambda x, k=k: x[k], peaks))
        rows += [highest, _fixed(g, moves, fixed)]
        hessians.append(hessian)
    return Rows(*(jnp.concatenate(field) for field in zip(*rows, strict=True))), jnp.stack(hessians)


def excess(problem: Problem, z: Variables, u: Scalar, name: str, limit: Scalar) -> Scalar:
    """g = ½((value/limit)² − 1) at the fraction `u` of the duration."""
    return Excess(problem, name, limit)(problem.course(z), u)


def _moves(problem: Problem, z: Variables) -> Moves:
    course, slopes, bends = with_derivatives(problem.course, z)
    n = z.shape[0]
    return Moves(course, slopes, in_a_row(slopes, n), in_a_row(bends, n, n))


def _highest(g: Excess, moves: Moves, peaks: Peaks) -> tuple[Rows, Float[Array, "k n n"]]:
    """The rows of one limit's peaks and ends, and their Hessians."""
    u, present, moving = peaks
    found = jax.vmap(lambda u: g.derivatives(moves, u))(u)
    bends = moving & (found.bend < 0)
    follows = jnp.where(bends, 1 / jnp.where(bends, found.bend, 1.0), 0.0)
    curvature = found.curvature - follows[:, None, None] * found.mixed[:, :, None] * found.mixed[:, None, :]
    sound = jnp.isfinite(found.value) & jnp.all(jnp.isfinite(found.slope), 1) & jnp.all(jnp.isfinite(curvature), (1, 2))
    height = jnp.where(present, jnp.where(sound, found.value, TOO_MUCH), ABSENT)
    kept = present & sound
    return Rows(height, _keep(found.slope, kept[:, None]), u, moving), _keep(curvature, kept[:, None, None])


def _fixed(g: Excess, moves: Moves, times: Float[Array, " r"]) -> Rows:
    """The rows of one limit at fixed times."""
    value, slope = jax.vmap(lambda u: g.slope(moves, u))(times)
    sound = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), 1)
    return Rows(jnp.where(sound, value, ABSENT), _keep(slope, sound[:, None]), times, jnp.zeros(times.shape, bool))


def _keep(x: Array, keep: Array) -> Array:
    return jnp.where(keep, x, jnp.zeros_like(x))


def _peaks(
    g: Callable[[Scalar], Scalar], peaks: int, slow: Scalar
) -> tuple[Float[Array, " k"], Bool[Array, " k"], Bool[Array, " k"]]:
    """The highest inner local maxima over the nodes, those next to both ends and to `slow`; which there are and move.

    Where a path nearly stops its curvature may rise to a needle between the nodes: it stands where the speed, which is
    smooth, is least.
    """
    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=slow.dtype)
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


def _slowest(problem: Problem, course: Course) -> Scalar:
    """Where the speed is least: the lowest of its inner local minima over the nodes, polished."""
    speed = Excess(problem, "speed", jnp.ones_like(course.duration))

    def slowness(u: Scalar) -> Scalar:
        return -speed(course, u)

    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=course.duration.dtype)
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
