"""Find the highest peaks of each constraint over time on a grid of instants, and refine them."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.constraints import FIRST_HINT, HINT_OF, HINTS, Setting, values
from qtraj.design.tuning.task import LimitSlots
from qtraj.foundation.argmin import min_and_argmin
from qtraj.foundation.indexing import element, with_element
from qtraj.foundation.types import Flag

NODES = 65
"""Number of grid instants."""

REFINED = 4
"""Number of local maxima at inner nodes that are refined, starting with the highest."""

FIXED = 3
"""Number of peaks that are always refined: near the hint (the slowest or straightest point) and near both ends."""

PEAKS = REFINED + FIXED

REACH = 1 / (NODES - 1)
"""The distance from a node, as a fraction of the duration, within which a peak near this node is sought."""

OFFSETS = 9
"""Number of instants about a peak in one round of refinement; all peaks together use almost `NODES` instants."""

ROUNDS = (1.0, 1 / 16, 1 / 256)
"""Half-widths of the intervals in the rounds, in units of `REACH`; each round ends with a parabola at the maximum."""

LIMIT_ROUNDS, HINT_ROUNDS = 2, 3
"""Number of rounds for limits and for hints; hints need more, because a small divisor results in a narrow peak."""

MIN_DISTANCE = 1e-5
"""Peaks count as equal if their times differ by less than this fraction of the duration."""

ABSENT = -1e3
"""The constraint value of unused elements."""

TOO_MUCH = 1e9
"""The value that replaces constraint values that are not finite."""


class Peaks(NamedTuple):
    """The peaks of all constraints, and the ends of the path; `present` marks the elements that are in use."""

    time: Float[Array, "*batch slots k"]  # fractions of the duration
    present: Bool[Array, "*batch slots k"]
    moving: Bool[Array, "*batch slots k"]  # true for inner peaks, whose times change with the variables
    value: Float[Array, "*batch slots k"]


def no_peaks(slots: int, dtype: Any) -> Peaks:
    """Return NumPy arrays of peaks without any used element."""
    no: Any = np.zeros((slots, PEAKS), bool)
    heights: Any = np.full(no.shape, ABSENT, dtype)
    start: Any = np.zeros(no.shape, dtype)
    return Peaks(start, no, no, heights)


def find_peaks(settings: Setting, slots: LimitSlots, limits: Float[Array, "batch slots"]) -> Peaks:
    """Find the peaks and ends of the constraints of all limits for a batch of paths."""
    quantity_index = jnp.asarray(slots.index)
    slot_hints = jnp.asarray(HINT_OF)[quantity_index]
    here = jnp.arange(len(HINTS), dtype=slots.index.dtype)
    batch = limits.shape[:1]
    # Compute the second hint, the straightest point, only if a limit needs it.
    positions = jnp.arange(quantity_index.shape[0], dtype=slots.index.dtype)
    n_hints = 1 + jnp.max(jnp.where(positions < slots.count, slot_hints, 0))

    def of_slot(step: Int[Array, ""], carry: tuple[Peaks, Array]) -> tuple[Peaks, Array]:
        peaks, hint_times = carry
        # First compute the hints (the times at which the path is straightest and slowest), in reverse order.
        is_hint = step < n_hints
        place, hint = jnp.where(is_hint, 0, step - n_hints), n_hints - 1 - step
        quantity, slot_hint = element((quantity_index, slot_hints), place)
        index = jnp.where(is_hint, FIRST_HINT + hint, quantity)
        at = jnp.sum(jnp.where((here == slot_hint)[None], hint_times, 0.0), axis=1)
        slot_peaks = _peaks(settings, index, element(limits, place, 1), at, is_hint)
        updated = with_element(peaks, place, slot_peaks, 1)
        highest = min_and_argmin(jnp.where(slot_peaks.present, -slot_peaks.value, jnp.inf), 1)[1]
        chosen = jnp.arange(PEAKS, dtype=jnp.int32)[None] == highest[:, None]
        hint_time = jnp.sum(jnp.where(chosen, slot_peaks.time, 0.0), axis=1)
        return updated, jnp.where((is_hint & (here == hint))[None], hint_time[:, None], hint_times)

    start = jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, *x.shape)), no_peaks(limits.shape[-1], limits.dtype))
    hint_times = jnp.full((*batch, len(HINTS)), 0.5, limits.dtype)
    peaks, _ = jax.lax.fori_loop(jnp.zeros_like(n_hints), n_hints + slots.count, of_slot, (start, hint_times))
    return peaks


def transfer_multipliers(multipliers: Array, times: Array, peaks: Peaks) -> Float[Array, "slots k"]:
    """Assign the multipliers of constraints at `times` to the nearest peak or end of the same limit."""
    distance = jnp.abs(peaks.time[:, :, None] - times[:, None]) + jnp.where(peaks.present, 0.0, 2.0)[:, :, None]
    nearest = jnp.argmin(distance, axis=1)
    here = nearest[:, None] == jnp.arange(peaks.time.shape[1])[None, :, None]
    return jnp.sum(jnp.where(here, multipliers[:, None], 0.0), axis=2)


class _Round(NamedTuple):
    """The state of the refinement: instants to evaluate, initial and current times of the peaks, and their values."""

    places: Float[Array, "batch nodes"]
    start: Float[Array, "batch k"]
    time: Float[Array, "batch k"]
    present: Bool[Array, "batch k"]
    value: Float[Array, "batch k"]


def _peaks(
    settings: Setting,
    index: Int[Array, ""],
    limits: Float[Array, " batch"],
    hints: Float[Array, " batch"],
    is_hint: Flag,
) -> Peaks:
    """Find the peaks of one quantity, or of a hint, for a batch of paths."""
    dtype, batch = limits.dtype, limits.shape[0]
    nodes = jnp.broadcast_to(jnp.asarray(np.linspace(0.0, 1.0, NODES)[None], dtype), (batch, NODES))
    offsets = jnp.asarray(np.linspace(-1.0, 1.0, OFFSETS)[:, None], dtype)
    rounds = jnp.where(is_hint, np.uint32(HINT_ROUNDS), np.uint32(LIMIT_ROUNDS))
    ends = jnp.stack([hints, jnp.zeros(batch, dtype), jnp.ones(batch, dtype)], axis=1)
    halves = REACH * jnp.asarray([*ROUNDS, 0.0], dtype)

    def look(k: Int[Array, ""], state: _Round) -> _Round:
        g = values(settings, index, limits, state.places)

        def choose() -> tuple[Array, Array]:
            picked, is_present = _highest_nodes(g)
            times = jnp.concatenate([picked, ends], axis=1)
            return times, jnp.concatenate([is_present, jnp.ones((batch, FIXED), bool)], axis=1)

        def refine() -> tuple[Array, Array]:
            at, values_at = (x[:, : OFFSETS * PEAKS].reshape(-1, OFFSETS, PEAKS) for x in (state.places, g))
            top = jax.vmap(_top_of_parabola, (0, 0, None))(at, values_at, is_hint)
            return jnp.where(k > rounds, state.time, top), state.present

        time, present = jax.lax.cond(k == 0, choose, refine)
        half = jnp.where(k < rounds, element(halves, k), 0.0)
        # Centre the interval on a peak, which may be narrow. The interval of a hint remains within [0, 1], because the
        # minimum of a divisor may be close to an end.
        middle = jnp.where(is_hint, jnp.clip(time, half, 1 - half), time)
        around = jnp.clip(middle[:, None] + half * offsets[None], 0.0, 1.0).reshape(batch, -1)
        centre = OFFSETS // 2 * PEAKS
        return _Round(
            jnp.concatenate([around, nodes[:, OFFSETS * PEAKS :]], axis=1),
            jnp.where(k == 0, time, state.start),
            time,
            present,
            g[:, centre : centre + PEAKS],
        )

    zeros = jnp.zeros((batch, PEAKS), dtype)
    initial = _Round(nodes, zeros, zeros, jnp.zeros((batch, PEAKS), bool), zeros)
    end = jax.lax.fori_loop(jnp.zeros_like(rounds), rounds + 2, look, initial)
    low, high = jnp.maximum(end.start - REACH, 0.0), jnp.minimum(end.start + REACH, 1.0)
    moving = (end.time > low) & (end.time < high)
    present = end.present & ~jax.vmap(_duplicates)(end.time, end.present)
    value = jnp.where(present, jnp.where(jnp.isfinite(end.value), end.value, TOO_MUCH), ABSENT)
    return Peaks(end.time, present, moving, value)


def _highest_nodes(g: Float[Array, "batch nodes"]) -> tuple[Float[Array, "batch picked"], Bool[Array, "batch picked"]]:
    """Return the times of the highest local maxima at inner nodes, and flags that are false for missing maxima."""
    finite = jnp.where(jnp.isnan(g), jnp.inf, g)
    middle = finite[:, 1:-1]
    heights = jnp.where((middle >= finite[:, :-2]) & (middle > finite[:, 2:]), middle, -jnp.inf)
    indices = jnp.arange(heights.shape[1], dtype=jnp.int32)

    def pick(heights: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
        below, place = min_and_argmin(-heights, 1)
        time = REACH * (place + 1).astype(g.dtype)
        return jnp.where(indices[None] == place[:, None], -jnp.inf, heights), (time, below < jnp.inf)

    times, present = jax.lax.scan(pick, heights, None, length=REFINED)[1]
    return times.T, present.T


def _top_of_parabola(
    at: Float[Array, "offsets k"], values_at: Float[Array, "offsets k"], is_hint: Flag
) -> Float[Array, " k"]:
    """Return the time of the maximum of the parabola through the highest value and its neighbours.

    If the highest value is the first or the last, return its instant, except for a hint. A hint is smooth, so its
    parabola is accurate there, too.
    """
    finite = jnp.where(values_at < TOO_MUCH, values_at, TOO_MUCH)  # also replaces NaN
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
    return jnp.where((best == inner) | (is_hint & (curvature > 0)), jnp.clip(top, left, right), edge)


def _duplicates(times: Array, present: Array) -> Array:
    """Return a mask of the times that repeat an earlier peak.

    Duplicates are removed, because their multipliers would not be unique.
    """
    k = times.shape[0]
    earlier = jnp.arange(k)[None] < jnp.arange(k)[:, None]
    return jnp.any(earlier & present[None] & (jnp.abs(times[None] - times[:, None]) < MIN_DISTANCE), axis=1)
