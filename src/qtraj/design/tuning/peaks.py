"""Find the highest peaks of each constraint over time on a grid of instants, and refine them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.searches import Curves, Searches
from qtraj.path.quantity import quantity

NODES = 65
GRID = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, NODES))
"""The Chebyshev nodes: grid instants that are denser near both ends."""

PER_LIMIT = 8
"""Number of local maxima of each limit that are refined, starting with the highest."""

SHOULDER = 0.25
"""A node is a candidate for a peak, too, if the higher one of its neighbours exceeds it by this part of its own excess
over the lower one: two peaks may be closer to each other than the nodes."""

EQUAL = 1e-6
"""Peaks of one limit closer than this fraction of the duration are one peak."""

RELEVANT = -1.5
"""Maxima below this constraint value are not refined: a quantity at a fifth of its limit constrains no step."""

MAX_PEAKS = 16
"""Maximum number of peaks and fixed times of a search in its subproblem, starting with the highest."""

FIXED = slice(0, NODES, 8)
"""The nodes at which a constraint with a constant time predicts new peaks after a step."""

BELOW = 0.3
"""The fixed times are used if their values are at most this much below the largest constraint value, or below 0."""

SHARP = 0.05
"""If the smallest value of a divisor is below this fraction of its largest, a peak near its minimum may be narrow."""

OFFSETS = np.linspace(-1.0, 1.0, 9)[:, None]
NARROW = np.concatenate([-(0.25 ** np.arange(9.0)), [0.0], 0.25 ** np.arange(8.0, -1.0, -1.0)])[:, None]
"""Instants about a node and about the minimum of a divisor, in units of the distance between nodes."""

NEWTON, NEGLIGIBLE = 8, 1e-9
"""Newton's method for the time of a peak ends when the value increases by less than the second number, where its error
is far below rounding error, or after the first number of steps."""


class Peaks(NamedTuple):
    """Peaks of the constraints of a batch of searches, each with its search, its rank in this search, and its limit.

    `fixed` marks constraints at fixed times instead of peaks.
    """

    owner: Int[np.ndarray, " peaks"]
    rank: Int[np.ndarray, " peaks"]
    limit: Int[np.ndarray, " peaks"]
    time: Float[np.ndarray, " peaks"]  # fractions of the duration
    value: Float[np.ndarray, " peaks"]
    fixed: Bool[np.ndarray, " peaks"]


@dataclass
class _Candidates:
    """Peaks before their refinement: the search of each, and an interval that contains the maximum."""

    owner: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray


def find_peaks(searches: Searches, curves: Curves) -> tuple[Peaks, Float[np.ndarray, " batch"]]:
    """Return the relevant peaks of a batch of searches, and the largest constraint value of each search."""
    names, order = tuple(searches.limits), searches.order
    rows = [np.broadcast_to(g, (NODES, searches.count)) for g in curves.values(names, GRID[:, None], order)]
    largest = np.maximum(np.max(rows, axis=(0, 1)), ABSENT)
    found = []
    for k, (name, g) in enumerate(zip(names, rows, strict=True)):
        refined = [
            (candidates.owner, *_refined(name, curves.at(candidates.owner), candidates, offsets))
            for candidates, offsets in ((_highest(g), OFFSETS), (_sharp(name, curves, searches.count), NARROW))
            if candidates.owner.size
        ]
        if refined:
            owner, time, value = _distinct(*(np.concatenate(x) for x in zip(*refined, strict=True)))
            found.append((owner, k, time, value, False))
            np.maximum.at(largest, owner, value)
    for k, g in enumerate(rows):
        owner, time, value = _at_fixed_times(g, largest)
        found.append((owner, k, time, value, True))
    columns = zip(*(np.broadcast_arrays(*x) for x in found), strict=True)
    return _ranked(*(np.concatenate(x) for x in columns)), largest


def largest_values(searches: Searches, z: Float[np.ndarray, "n batch"]) -> Float[np.ndarray, "limits batch"]:
    """Return the largest constraint value of each limit."""
    with np.errstate(all="ignore"):
        curves = Curves(searches, z)
        peaks, _ = find_peaks(searches, curves)
        rows = curves.values(tuple(searches.limits), GRID[:, None], searches.order)
        result = np.array([np.broadcast_to(g, (NODES, searches.count)).max(axis=0) for g in rows])
        np.maximum.at(result, (peaks.limit, peaks.owner), peaks.value)
    return result


def _distinct(owner: np.ndarray, time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the peaks without those that were found twice."""
    order = np.lexsort((time, owner))
    owner, time, value = owner[order], time[order], value[order]
    new = np.ones(owner.size, bool)
    new[1:] = (owner[1:] != owner[:-1]) | (time[1:] - time[:-1] > EQUAL)
    return owner[new], time[new], value[new]


def _at_fixed_times(g: np.ndarray, largest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the searches, the times and the values of the constraints at fixed times."""
    own = g[FIXED]
    used = own > np.maximum(largest, 0.0) - BELOW
    used[0] &= g[1] > g[0]  # otherwise the end is a peak
    used[-1] &= g[-2] > g[-1]
    node, owner = np.nonzero(used)
    return owner, GRID[FIXED][node], own[node, owner]


def _ranked(owner: np.ndarray, limit: np.ndarray, time: np.ndarray, value: np.ndarray, fixed: np.ndarray) -> Peaks:
    """Return the relevant peaks in descending order of each search, without those beyond the maximum number."""
    order = np.flatnonzero(value > RELEVANT)
    order = order[np.lexsort((-value[order], owner[order]))]
    owner = owner[order]
    first = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]])[: owner.size])
    rank = np.arange(owner.size) - np.repeat(first, np.diff(np.append(first, owner.size)))
    kept = rank < MAX_PEAKS
    parts = (limit, time, value, fixed)
    return Peaks(owner[kept], rank[kept], *(x[order][kept] for x in parts))


def _highest(g: Float[np.ndarray, "nodes batch"]) -> _Candidates:
    """Return the highest local maxima of each search at the nodes, and the shoulders beside them."""
    rise, drop = np.zeros(g.shape), np.zeros(g.shape)
    rise[1:] = g[1:] - g[:-1]
    drop[:-1] = -rise[1:]
    is_peak = (rise >= -SHOULDER * drop) & (drop >= -SHOULDER * rise)
    heights = np.where(is_peak & (g > RELEVANT), g, -np.inf)
    if np.max(np.count_nonzero(heights > -np.inf, axis=0), initial=0) > PER_LIMIT:
        lowest = np.partition(heights, -PER_LIMIT, axis=0)[-PER_LIMIT]
        heights = np.where(heights >= lowest, heights, -np.inf)
    node, owner = np.nonzero(heights > -np.inf)
    return _Candidates(owner, GRID[np.maximum(node - 1, 0)], GRID[node], GRID[np.minimum(node + 1, NODES - 1)])


def _sharp(name: str, curves: Curves, count: int) -> _Candidates:
    """Return candidates near the minimum of the quantity's divisor, if this minimum is small."""
    none = np.zeros(0)
    divisor = quantity(name).divisor
    if divisor is None:
        return _Candidates(np.zeros(0, int), none, none, none)
    key = "N" if divisor == "cross_norm" else "S"
    values = np.broadcast_to(curves.divisors(GRID[:, None])[key], (NODES, count))
    owner = np.flatnonzero(values.min(axis=0) < SHARP * values.max(axis=0))
    node = values[:, owner].argmin(axis=0)
    low, middle, high = GRID[np.maximum(node - 1, 0)], GRID[node], GRID[np.minimum(node + 1, NODES - 1)]
    own = curves.at(owner)
    for _ in range(3 if owner.size else 0):
        u = _instants(low, middle, high, OFFSETS)
        depth = -np.log(np.maximum(own.divisors(u)[key], 1e-300))
        low, middle, high = _parabola(u, depth, depth.argmax(axis=0))
    return _Candidates(owner, np.maximum(middle - 0.02, 0.0), middle, np.minimum(middle + 0.02, 1.0))


def _instants(low: np.ndarray, middle: np.ndarray, high: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    return middle + np.where(offsets < 0, middle - low, high - middle) * offsets


def _top(g: np.ndarray) -> np.ndarray:
    """Return the indices of the highest local maxima inside, or else of the highest values."""
    inside = (g[1:-1] >= g[:-2]) & (g[1:-1] >= g[2:])
    best = 1 + np.where(inside, g[1:-1], -np.inf).argmax(axis=0)
    return np.where(inside.any(axis=0), best, g.argmax(axis=0))


def _parabola(u: np.ndarray, g: np.ndarray, best: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times about the value of index `best`, and between them the top of the parabola through these."""
    last = len(u) - 1
    points = np.arange(best.size)
    index = np.clip(best, 1, last - 1)
    (a, x), (b, y), (c, z) = ((u[index + k, points], g[index + k, points]) for k in (-1, 0, 1))
    with np.errstate(all="ignore"):
        left, right = (y - x) / (b - a), (z - y) / (c - b)
        top = 0.5 * (a + b) - left * (c - a) / (2 * (right - left))  # zero of the interpolated slope
    low, high = u[np.maximum(best - 1, 0), points], u[np.minimum(best + 1, last), points]
    middle = u[best, points]
    good = np.isfinite(top) & (top >= low) & (top <= high) & (right < left)
    return low, np.where(good, top, middle), high


def _refined(name: str, curves: Curves, at: _Candidates, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the values of the maxima."""
    order = quantity(name).order
    u = _instants(at.low, at.middle, at.high, offsets)
    g = np.broadcast_to(curves.values([name], u, order)[0], u.shape)
    points = np.arange(u.shape[1])
    best = _top(g)
    time, value = u[best, points], g[best, points]
    low, trial, high = _parabola(u, g, best)
    top, height, rest = np.array(trial), np.array(value), points
    for _ in range(NEWTON):
        there, rate, second = curves.along_u(name, trial, order)
        bend = np.where(second < 0, second, -np.inf)
        exact = np.clip(trial - rate / bend, low, high)
        # The value at the next point of Newton's method, to third order.
        gain = (rate + 0.5 * np.where(second < 0, second, 0.0) * (exact - trial)) * (exact - trial)
        top[rest], height[rest] = exact, there + gain
        on = np.flatnonzero(gain > NEGLIGIBLE)
        if on.size == 0:
            break
        rest, low, high, trial, curves = rest[on], low[on], high[on], exact[on], curves.at(on)
    better = height >= value
    return np.where(better, top, time), np.where(better, height, value)


def peaks_of(peaks: Peaks, index: np.ndarray, count: int) -> Peaks:
    """Return the peaks of the searches with these indices, renumbered."""
    if index.size == count:
        return peaks
    number = np.full(count, -1)
    number[index] = np.arange(index.size)
    owner = number[peaks.owner]
    kept = owner >= 0
    return Peaks(owner[kept], *(x[kept] for x in peaks[1:]))


def without(peaks: Peaks, index: np.ndarray) -> Peaks:
    """Return the peaks of all searches except those with these indices."""
    kept = ~np.isin(peaks.owner, index)
    return Peaks(*(x[kept] for x in peaks))


def renumbered(peaks: Peaks, index: np.ndarray, chosen: np.ndarray) -> Peaks:
    """Return the peaks of the chosen searches of a smaller batch, with the numbers of the larger batch."""
    kept = chosen[peaks.owner]
    return Peaks(index[peaks.owner[kept]], *(x[kept] for x in peaks[1:]))


def joined(a: Peaks, b: Peaks) -> Peaks:
    """Return the peaks of both arguments."""
    return Peaks(*(np.concatenate(x) for x in zip(a, b, strict=True)))
