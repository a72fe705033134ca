"""The limits on a path as inequality rows: each at its highest peaks in time, with derivatives in the variables.

A row is g(z, u) = ½((value/limit)² − 1) ≤ 0 at a fraction u of the duration. At an inner peak u moves with z so that
∂g/∂u = 0: the gradient of the peak is ∂g/∂z (envelope theorem), its Hessian g_zz − g_zu g_uz/g_uu. At an end it stands
still. Fixed times between them, with gradients alone, foretell the peaks that a step would raise.

The rows are differentiated in the few numbers that make up the path, its course, and the course in z: once for all of
them.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from qtraj.design.limits import Limits
from qtraj.design.magnitudes import PER_TIME, squared
from qtraj.design.peaks import climb, highest
from qtraj.design.tuning.problem import Course, Problem, Variables
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
    excesses = [partial(_Excess(problem, name, limit), course) for name, limit in limits.given().items()]
    found = [_peaks(g, number, slow) for g in excesses]
    return Peaks(*(jnp.stack(column) for column in zip(*found, strict=True)))


def values_at(problem: Problem, limits: Limits, z: Variables, peaks: Peaks) -> Float[Array, "limits k"]:
    """The values at peaks and ends."""

    def of(name: str, limit: Scalar, times: Float[Array, " k"]) -> Float[Array, " k"]:
        return jax.vmap(lambda u: excess(problem, z, u, name, limit))(times)

    values = jnp.stack([of(name, limit, peaks.time[k]) for k, (name, limit) in enumerate(limits.given().items())])
    return jnp.where(peaks.present, jnp.where(jnp.isfinite(values), values, TOO_MUCH), ABSENT)


def values_nearby(problem: Problem, limits: Limits, z: Variables, rows: Rows) -> Float[Array, " m"]:
    """The values at `z` of rows that stand elsewhere, their peaks followed to where they are; absent ones stay so."""
    given, course = limits.given(), problem.course(z)
    times, moving = (x.reshape(len(given), -1) for x in (rows.time, rows.moving))
    number = peaks_of_each(limits) + ALWAYS
    values = []
    for k, (name, limit) in enumerate(given.items()):
        g = partial(_Excess(problem, name, limit), course)
        peaks = times[k, :number]
        followed, _ = _polished(g, peaks, jnp.where(moving[k, :number], FOLLOWED, REACH))
        values.append(jax.vmap(g)(jnp.concatenate([followed, times[k, number:]])))
    flat = jnp.concatenate(values)
    return jnp.where(rows.value > ABSENT, jnp.where(jnp.isfinite(flat), flat, rows.value), ABSENT)


def rows_at(problem: Problem, limits: Limits, z: Variables, peaks: Peaks) -> tuple[Rows, Float[Array, "limits k n n"]]:
    """All rows of all limits at `z`, peaks and ends before fixed times, and the Hessians of peaks and ends."""
    fixed = jnp.linspace(0.0, 1.0, NODES, dtype=z.dtype)[STRIDE:-1:STRIDE]
    made = _made(problem, z)
    rows, hessians = [], []
    for k, (name, limit) in enumerate(limits.given().items()):
        g = _Excess(problem, name, limit)
        highest, hessian = _highest(g, made, jax.tree.map(lambda x, k=k: x[k], peaks))
        rows += [highest, _fixed(g, made, fixed)]
        hessians.append(hessian)
    return Rows(*(jnp.concatenate(field) for field in zip(*rows, strict=True))), jnp.stack(hessians)


def excess(problem: Problem, z: Variables, u: Scalar, name: str, limit: Scalar) -> Scalar:
    """g = ½((value/limit)² − 1) at the fraction `u` of the duration."""
    return _Excess(problem, name, limit)(problem.course(z), u)


class _Excess(NamedTuple):
    """g of one limit, in the course of the path and the fraction of its duration."""

    problem: Problem
    name: str
    limit: Scalar

    def __call__(self, course: Course, u: Scalar) -> Scalar:
        # In unit time, which is simpler to differentiate: the limit is scaled instead.
        scaled = self.limit * course.duration ** PER_TIME[self.name]
        return 0.5 * (squared(self.problem.unit_path(course), u, self.name) / scaled**2 - 1.0)


class _Made(NamedTuple):
    """A course and its derivatives in the variables, all its numbers in a row."""

    course: Course
    directions: Course  # (n, …): what each variable does to it
    slopes: Float[Array, "q n"]
    bends: Float[Array, "q n n"]


def _made(problem: Problem, z: Variables) -> _Made:
    slopes, bends = jax.jacfwd(problem.course)(z), jax.jacfwd(jax.jacfwd(problem.course))(z)
    directions = jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), slopes)
    n = z.shape[0]
    return _Made(problem.course(z), directions, _in_a_row(slopes, n), _in_a_row(bends, n, n))


def _in_a_row(course: Course, *rest: int) -> Float[Array, "q *rest"]:
    """All numbers of a course, or what belongs to each of them."""
    return jnp.concatenate([x.reshape(-1, *rest) for x in course])


def _highest(g: _Excess, made: _Made, peaks: Peaks) -> tuple[Rows, Float[Array, "k n n"]]:
    """The rows of one limit's peaks and ends, and their Hessians."""
    u, present, moves = peaks
    course = made.course

    def pair(course: Course, u: Scalar) -> tuple[Scalar, Course]:
        return jax.value_and_grad(g)(course, u)

    def turned_by(direction: Course, u: Scalar) -> Course:
        return jax.jvp(lambda course: pair(course, u)[1], (course,), (direction,))[1]

    def at(u: Scalar) -> tuple[Array, ...]:
        one = jnp.ones_like(u)
        (value, slope), (_, mixed) = jax.jvp(lambda u: pair(course, u), (u,), (one,))
        bend = jax.jvp(lambda u: jax.jvp(lambda u: g(course, u), (u,), (one,))[1], (u,), (one,))[1]
        turned = jax.vmap(turned_by, (0, None))(made.directions, u)
        return value, _in_a_row(slope), _in_a_row(mixed), bend, jnp.concatenate([_columns(x) for x in turned], axis=1)

    value, slope, mixed, bend, turned = jax.vmap(at)(u)
    slope, mixed, pulled = slope @ made.slopes, mixed @ made.slopes, jnp.tensordot(slope, made.bends, 1)
    bends = moves & (bend < 0)
    moving = jnp.where(bends, 1 / jnp.where(bends, bend, 1.0), 0.0)
    curvature = turned @ made.slopes + pulled - moving[:, None, None] * mixed[:, :, None] * mixed[:, None, :]
    sound = jnp.isfinite(value) & jnp.all(jnp.isfinite(slope), 1) & jnp.all(jnp.isfinite(curvature), (1, 2))
    height = jnp.where(present, jnp.where(sound, value, TOO_MUCH), ABSENT)
    kept = present & sound
    return Rows(height, _keep(slope, kept[:, None]), u, moves), _keep(curvature, kept[:, None, None])


def _columns(x: Float[Array, "n *part"]) -> Float[Array, "n part"]:
    return x.reshape(x.shape[0], -1)


def _fixed(g: _Excess, made: _Made, times: Float[Array, " r"]) -> Rows:
    """The rows of one limit at fixed times."""
    value, of_course = jax.vmap(jax.value_and_grad(g), (None, 0))(made.course, times)
    slope = jax.vmap(_in_a_row)(of_course) @ made.slopes
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
    path = problem.unit_path(course)

    def slowness(u: Scalar) -> Scalar:
        return -squared(path, u, "speed")

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
