"""The highest peaks in time of each constraint: sampled on a grid, then refined."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.constraints import FIRST_HINT, HINT_OF, HINTS, Setting, values
from qtraj.design.tuning.task import LimitSlots
from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.types import Flag, Scalar

NODES = 65
"""Number of grid times."""

REFINED = 4
"""Number of the highest inner local maxima that are refined."""

FIXED = 3
"""Number of peaks that are always refined: at the hint (the slowest or straightest point), and next to both ends."""

PEAKS = REFINED + FIXED

REACH = 1 / (NODES - 1)
"""A peak is searched within this distance of its node."""

OFFSETS = 9
"""Number of places about a peak in one round of refinement: for all peaks together nearly as many as nodes."""

ROUNDS = (1.0, 1 / 16, 1 / 256)
"""Half-widths of the intervals of the rounds, in units of REACH; each round ends with a parabola at the maximum."""

LIMIT_ROUNDS, HINT_ROUNDS = 2, 3
"""Rounds for the peaks of a limit, and for hints: a peak of a quantity is as narrow as its divisor is small."""

MIN_DISTANCE = 1e-5
"""Peaks closer than this fraction of the duration are the same peak."""

ABSENT = -1e3
"""The constraint value in a place without a peak."""

TOO_MUCH = 1e9
"""The constraint value that replaces one that is not finite."""


class Peaks(NamedTuple):
    """The peaks and ends of all constraints: times as fractions of the duration, presence, and values."""

    time: Float[Array, "slots k"]
    present: Bool[Array, "slots k"]
    moving: Bool[Array, "slots k"]  # an inner peak, whose time changes with the variables
    value: Float[Array, "slots k"]


def no_peaks(slots: int, dtype: Any) -> Peaks:
    """Peaks of which none is present, in NumPy arrays."""
    no: Any = np.zeros((slots, PEAKS), bool)
    heights: Any = np.full(no.shape, ABSENT, dtype)
    start: Any = np.zeros(no.shape, dtype)
    return Peaks(start, no, no, heights)


def find_peaks(setting: Setting, slots: LimitSlots, limits: Float[Array, " slots"]) -> Peaks:
    """The peaks and ends of the constraints of all limits."""
    quantity_index, hints = jnp.asarray(slots.index), jnp.asarray(HINT_OF)
    here = jnp.arange(len(HINTS), dtype=jnp.int32)

    def of_slot(slot: Int[Array, ""], carry: tuple[Peaks, Array]) -> tuple[Peaks, Array]:
        peaks, hint_times = carry
        # Slots below zero come first: the times at which the path is slowest and straightest.
        place, hint = jnp.maximum(slot, 0), -1 - slot
        index = jnp.where(slot < 0, FIRST_HINT + hint, quantity_index[place])
        at = jnp.sum(jnp.where(here == hints[quantity_index[place]], hint_times, 0.0))
        rounds = jnp.where(slot < 0, HINT_ROUNDS, LIMIT_ROUNDS)
        slot_peaks = _peaks(setting, index, limits[place], at, rounds)
        updated = jax.tree.map(lambda x, one: x.at[place].set(one), peaks, slot_peaks)
        highest = min_and_argmin(jnp.where(slot_peaks.present, -slot_peaks.value, jnp.inf))[1]
        return updated, jnp.where(here == hint, slot_peaks.time[highest], hint_times)

    # Few quantities need the straightest point.
    positions = jnp.arange(quantity_index.shape[0], dtype=jnp.int32)
    first = -1 - jnp.max(jnp.where(positions < slots.count, hints[quantity_index], 0))
    start = jax.tree.map(jnp.asarray, no_peaks(limits.shape[0], limits.dtype)), jnp.full(len(HINTS), 0.5, limits.dtype)
    peaks, _ = jax.lax.fori_loop(first, jnp.asarray(slots.count), of_slot, start)
    return peaks


def transfer_multipliers(multipliers: Array, times: Array, peaks: Peaks) -> Float[Array, "slots k"]:
    """The multipliers of constraints at `times`, each transferred to the nearest peak or end of the same limit."""
    distance = jnp.abs(peaks.time[:, :, None] - times[:, None]) + jnp.where(peaks.present, 0.0, 2.0)[:, :, None]
    nearest = jnp.argmin(distance, axis=1)
    here = nearest[:, None] == jnp.arange(peaks.time.shape[1])[None, :, None]
    return jnp.sum(jnp.where(here, multipliers[:, None], 0.0), axis=2)


class _Round(NamedTuple):
    """The state of the refinement: places to evaluate, initial and current times of the peaks, and their values."""

    places: Float[Array, " nodes"]
    start: Float[Array, " k"]
    time: Float[Array, " k"]
    present: Bool[Array, " k"]
    value: Float[Array, " k"]


def _peaks(setting: Setting, index: Int[Array, ""], limit: Scalar, hint: Scalar, rounds: Int[Array, ""]) -> Peaks:
    dtype = limit.dtype
    nodes = jnp.linspace(0.0, 1.0, NODES, dtype=dtype)
    offsets = jnp.linspace(-1.0, 1.0, OFFSETS, dtype=dtype)[:, None]
    is_hint = rounds > LIMIT_ROUNDS
    ends = jnp.stack([hint, jnp.zeros((), dtype), jnp.ones((), dtype)])
    halves = REACH * jnp.asarray([*ROUNDS, 0.0], dtype)

    def look(k: Int[Array, ""], state: _Round) -> _Round:
        g = values(setting, index, limit, state.places)

        def choose() -> tuple[Array, Array]:
            picked, is_present = _highest_nodes(g)
            return jnp.concatenate([picked, ends]), jnp.concatenate([is_present, jnp.ones(FIXED, bool)])

        def refine() -> tuple[Array, Array]:
            at, values_at = (x[: OFFSETS * PEAKS].reshape(OFFSETS, PEAKS) for x in (state.places, g))
            return jnp.where(k > rounds, state.time, _top_of_parabola(at, values_at, is_hint)), state.present

        time, present = jax.lax.cond(k == 0, choose, refine)
        half = jnp.where(k < rounds, halves[k], 0.0)
        # A narrow peak may lie at the time itself; the minimum of a divisor may lie close to an end.
        middle = jnp.where(is_hint, jnp.clip(time, half, 1 - half), time)
        around = jnp.clip(middle[None] + half * offsets, 0.0, 1.0).reshape(-1)
        centre = OFFSETS // 2 * PEAKS
        return _Round(
            jnp.concatenate([around, nodes[OFFSETS * PEAKS :]]),
            jnp.where(k == 0, time, state.start),
            time,
            present,
            g[centre : centre + PEAKS],
        )

    zeros = jnp.zeros(PEAKS, dtype)
    initial = _Round(nodes, zeros, zeros, jnp.zeros(PEAKS, bool), zeros)
    end = jax.lax.fori_loop(0, rounds + 2, look, initial)
    low, high = jnp.maximum(end.start - REACH, 0.0), jnp.minimum(end.start + REACH, 1.0)
    moving = (end.time > low) & (end.time < high)
    present = end.present & ~_duplicates(end.time, end.present)
    value = jnp.where(present, jnp.where(jnp.isfinite(end.value), end.value, TOO_MUCH), ABSENT)
    return Peaks(end.time, present, moving, value)


def _highest_nodes(g: Float[Array, " nodes"]) -> tuple[Float[Array, " picked"], Bool[Array, " picked"]]:
    """The times of the highest local maxima at inner nodes, and which of them are present."""
    finite = jnp.where(jnp.isnan(g), jnp.inf, g)
    middle = finite[1:-1]
    heights = jnp.where((middle >= finite[:-2]) & (middle > finite[2:]), middle, -jnp.inf)
    indices = jnp.arange(heights.shape[0], dtype=jnp.int32)

    def pick(heights: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
        below, place = min_and_argmin(-heights)
        time = REACH * (place + 1).astype(g.dtype)
        return jnp.where(indices == place, -jnp.inf, heights), (time, below < jnp.inf)

    return jax.lax.scan(pick, heights, None, length=REFINED)[1]


def _top_of_parabola(
    at: Float[Array, "offsets k"], values_at: Float[Array, "offsets k"], hint: Flag
) -> Float[Array, " k"]:
    """The maximum of the parabola about the highest place, or that place itself if it is the first or the last.

    A hint is smooth, so its parabola is used there, too.
    """
    finite = jnp.where(values_at < TOO_MUCH, values_at, TOO_MUCH)  # NaN too
    best = jnp.argmax(finite, axis=0)
    inner = jnp.clip(best, 1, OFFSETS - 2)
    here = jnp.arange(OFFSETS)[:, None]

    def neighbour(k: int) -> tuple[Array, Array]:
        chosen = here == (inner + k)[None]
        return jnp.sum(jnp.where(chosen, at, 0.0), axis=0), jnp.sum(jnp.where(chosen, finite, 0.0), axis=0)

    (left, low), (centre, middle), (right, high) = (neighbour(k) for k in (-1, 0, 1))
    curvature = 2 * middle - low - high
    top = centre + jnp.where(
        curvature > 0, 0.25 * (right - left) * (high - low) / jnp.where(curvature > 0, curvature, 1.0), 0.0
    )
    edge = jnp.where(best == 0, left, right)
    return jnp.where((best == inner) | (hint & (curvature > 0)), jnp.clip(top, left, right), edge)


def _duplicates(times: Array, present: Array) -> Array:
    """Which times repeat an earlier peak. Duplicates are removed, because their multipliers would not be unique."""
    k = times.shape[0]
    earlier = jnp.arange(k)[None] < jnp.arange(k)[:, None]
    return jnp.any(earlier & present[None] & (jnp.abs(times[None] - times[:, None]) < MIN_DISTANCE), axis=1)
