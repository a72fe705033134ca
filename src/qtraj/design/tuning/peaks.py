"""The highest peaks of each constraint in time."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.constraints import FIRST_HINT, HINT, HINTS, Setting, values
from qtraj.design.tuning.task import SLOTS, Present
from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.types import Flag, Scalar

NODES = 65
"""Times at which peaks are sought."""

PICKED = 4
"""Of the highest inner local maxima so many are refined."""

ALWAYS = 3
"""Peaks that are always sought: where the path is slowest or straightest, and next to both ends."""

PEAKS = PICKED + ALWAYS

REACH = 1 / (NODES - 1)
"""So far from its node a peak is sought."""

OFFSETS = 9
"""Places about a peak at which one round of refinement looks: for all peaks together nearly as many as nodes."""

ROUNDS = (1.0, 1 / 16, 1 / 256)
"""The halves of the intervals of the rounds, in reaches; a parabola through the three highest places ends each."""

OF_LIMITS, OF_HINTS = 2, 3
"""Rounds for the peaks of a limit, and for hints: a needle of a quantity is as narrow as its divisor is small."""

SAME = 1e-5
"""Peaks nearer to each other are one; a fraction of the duration."""

ABSENT = -1e3
"""The value of a constraint at a peak that is not there."""

TOO_MUCH = 1e9
"""The value of a constraint that is not finite."""


class Peaks(NamedTuple):
    """Where the peaks and ends of all constraints stand, which of them there are, and how high they are."""

    time: Float[Array, "slots k"]
    present: Bool[Array, "slots k"]
    moving: Bool[Array, "slots k"]  # an inner peak, whose time changes with the variables
    value: Float[Array, "slots k"]


def none(dtype: Any) -> Peaks:
    """No peaks of any constraint, in NumPy arrays."""
    no: Any = np.zeros((SLOTS, PEAKS), bool)
    nowhere: Any = np.full(no.shape, ABSENT, dtype)
    start: Any = np.zeros(no.shape, dtype)
    return Peaks(start, no, no, nowhere)


def find_peaks(setting: Setting, which: Present, limits: Float[Array, " slots"]) -> Peaks:
    """The peaks and ends of all constraints that are present."""

    given, hints = jnp.asarray(which.index), jnp.asarray(HINT)
    here = jnp.arange(len(HINTS), dtype=jnp.int32)

    def of_slot(slot: Int[Array, ""], found: tuple[Peaks, Array]) -> tuple[Peaks, Array]:
        peaks, least_at = found
        # First of all, at slots below zero, where the path is slowest and where it is straightest.
        place, hint = jnp.maximum(slot, 0), -1 - slot
        index = jnp.where(slot < 0, FIRST_HINT + hint, given[place])
        at = jnp.sum(jnp.where(here == hints[given[place]], least_at, 0.0))
        rounds = jnp.where(slot < 0, OF_HINTS, OF_LIMITS)
        own = _peaks(setting, index, limits[place], at, rounds)
        whole = jax.tree.map(lambda x, one: x.at[place].set(one), peaks, own)
        highest = min_and_argmin(jnp.where(own.present, -own.value, jnp.inf))[1]
        return whole, jnp.where(here == hint, own.time[highest], least_at)

    # Where it is straightest matters to few quantities.
    slots = jnp.arange(given.shape[0], dtype=jnp.int32)
    first = -1 - jnp.max(jnp.where(slots < which.count, hints[given], 0))
    start = jax.tree.map(jnp.asarray, none(limits.dtype)), jnp.full(len(HINTS), 0.5, limits.dtype)
    peaks, _ = jax.lax.fori_loop(first, jnp.asarray(which.count), of_slot, start)
    return peaks


def hand_over(multipliers: Array, times: Array, peaks: Peaks) -> Float[Array, "slots k"]:
    """The multipliers of the constraints, each given to the nearest peak or end of its limit that there is."""
    distance = jnp.abs(peaks.time[:, :, None] - times[:, None]) + jnp.where(peaks.present, 0.0, 2.0)[:, :, None]
    nearest = jnp.argmin(distance, axis=1)
    here = nearest[:, None] == jnp.arange(peaks.time.shape[1])[None, :, None]
    return jnp.sum(jnp.where(here, multipliers[:, None], 0.0), axis=2)


class _Round(NamedTuple):
    """A round of the search: places to look at, where peaks were first suspected and now stand, and their values."""

    places: Float[Array, " nodes"]
    start: Float[Array, " k"]
    time: Float[Array, " k"]
    present: Bool[Array, " k"]
    value: Float[Array, " k"]


def _peaks(setting: Setting, index: Int[Array, ""], limit: Scalar, hint: Scalar, rounds: Int[Array, ""]) -> Peaks:
    dtype = limit.dtype
    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=dtype)
    offsets = jnp.linspace(-1.0, 1.0, OFFSETS, dtype=dtype)[:, None]
    is_hint = rounds > OF_LIMITS
    ends = jnp.stack([hint, jnp.zeros((), dtype), jnp.ones((), dtype)])
    halves = REACH * jnp.asarray([*ROUNDS, 0.0], dtype)

    def look(k: Int[Array, ""], now: _Round) -> _Round:
        g = values(setting, index, limit, now.places)

        def choose() -> tuple[Array, Array]:
            picked, there = _highest_nodes(g)
            return jnp.concatenate([picked, ends]), jnp.concatenate([there, jnp.ones(ALWAYS, bool)])

        def refine() -> tuple[Array, Array]:
            at, seen = (x[: OFFSETS * PEAKS].reshape(OFFSETS, PEAKS) for x in (now.places, g))
            return jnp.where(k > rounds, now.time, _top_of_parabola(at, seen, is_hint)), now.present

        time, present = jax.lax.cond(k == 0, choose, refine)
        half = jnp.where(k < rounds, halves[k], 0.0)
        # About the time itself, where a needle may stand; the least of a divisor may lie close to an end.
        middle = jnp.where(is_hint, jnp.clip(time, half, 1 - half), time)
        around = jnp.clip(middle[None] + half * offsets, 0.0, 1.0).reshape(-1)
        centre = OFFSETS // 2 * PEAKS
        return _Round(
            jnp.concatenate([around, nodes[OFFSETS * PEAKS :]]),
            jnp.where(k == 0, time, now.start),
            time,
            present,
            g[centre : centre + PEAKS],
        )

    nothing = jnp.zeros(PEAKS, dtype)
    begun = _Round(nodes, nothing, nothing, jnp.zeros(PEAKS, bool), nothing)
    end = jax.lax.fori_loop(0, rounds + 2, look, begun)
    low, high = jnp.maximum(end.start - REACH, 0.0), jnp.minimum(end.start + REACH, 1.0)
    moving = (end.time > low) & (end.time < high)
    present = end.present & ~_repeated(end.time, end.present)
    value = jnp.where(present, jnp.where(jnp.isfinite(end.value), end.value, TOO_MUCH), ABSENT)
    return Peaks(end.time, present, moving, value)


def _highest_nodes(g: Float[Array, " nodes"]) -> tuple[Float[Array, " picked"], Bool[Array, " picked"]]:
    """The inner nodes of the highest local maxima, and which of them there are."""
    known = jnp.where(jnp.isnan(g), jnp.inf, g)
    middle = known[1:-1]
    heights = jnp.where((middle >= known[:-2]) & (middle > known[2:]), middle, -jnp.inf)
    rows = jnp.arange(heights.shape[0], dtype=jnp.int32)

    def pick(heights: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
        below, place = min_and_argmin(-heights)
        time = REACH * (place + 1).astype(g.dtype)
        return jnp.where(rows == place, -jnp.inf, heights), (time, below < jnp.inf)

    return jax.lax.scan(pick, heights, None, length=PICKED)[1]


def _top_of_parabola(at: Float[Array, "offsets k"], seen: Float[Array, "offsets k"], hint: Flag) -> Float[Array, " k"]:
    """The top of the parabola about the highest place; where that is the first or the last, the place itself.

    Of a hint, which is smooth, the parabola tells even there.
    """
    known = jnp.where(seen < TOO_MUCH, seen, TOO_MUCH)  # NaN too
    best = jnp.argmax(known, axis=0)
    inner = jnp.clip(best, 1, OFFSETS - 2)
    here = jnp.arange(OFFSETS)[:, None]

    def beside(k: int) -> tuple[Array, Array]:
        chosen = here == (inner + k)[None]
        return jnp.sum(jnp.where(chosen, at, 0.0), axis=0), jnp.sum(jnp.where(chosen, known, 0.0), axis=0)

    (left, low), (centre, middle), (right, high) = (beside(k) for k in (-1, 0, 1))
    fall = 2 * middle - low - high
    top = centre + jnp.where(fall > 0, 0.25 * (right - left) * (high - low) / jnp.where(fall > 0, fall, 1.0), 0.0)
    edge = jnp.where(best == 0, left, right)
    return jnp.where((best == inner) | (hint & (fall > 0)), jnp.clip(top, left, right), edge)


def _repeated(times: Array, present: Array) -> Array:
    """Which times are those of an earlier peak: one constraint for each, or their multipliers are not unique."""
    k = times.shape[0]
    earlier = jnp.arange(k)[None] < jnp.arange(k)[:, None]
    return jnp.any(earlier & present[None] & (jnp.abs(times[None] - times[:, None]) < SAME), axis=1)
