"""Find the highest peaks of each constraint over time on a grid of instants, and refine them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.maxima import (
    GRID,
    NARROW,
    NODES,
    OFFSETS,
    RELEVANT,
    RELEVANT_CLEARANCE,
    highest,
    refined,
    sharp,
)
from qtraj.design.tuning.searches import Curves, Searches
from qtraj.design.tuning.travelled import Travelled
from qtraj.design.tuning.zone_peaks import zone_peaks

EQUAL = 1e-6
"""Peaks of one limit closer than this fraction of the duration are one peak."""

MAX_PEAKS = 16
"""Maximum number of peaks and fixed times of a search in its subproblem, starting with the highest."""

CORNER = 5
"""Number of parabolas by which the peak of a constraint on walls is refined, which is narrow at a corner."""

FIXED = slice(0, NODES, 8)
"""The nodes at which a constraint with a constant time predicts new peaks after a step."""

BELOW = 0.3
"""The fixed times are used if their values are at most this much below the largest constraint value, or below 0."""


class Peaks(NamedTuple):
    """Peaks of the constraints of a batch of searches, each with its search, its rank in this search, and its limit.

    `fixed` marks constraints at fixed times instead of peaks, and `edge` those at an end of a zone, which is at a fixed
    distance.
    """

    owner: Int[np.ndarray, " peaks"]
    rank: Int[np.ndarray, " peaks"]
    limit: Int[np.ndarray, " peaks"]
    time: Float[np.ndarray, " peaks"]  # fractions of the duration
    value: Float[np.ndarray, " peaks"]
    fixed: Bool[np.ndarray, " peaks"]
    edge: Bool[np.ndarray, " peaks"]


def find_peaks(searches: Searches, curves: Curves) -> tuple[Peaks, Float[np.ndarray, " batch"]]:
    """Return the relevant peaks of a batch of searches, and the largest constraint value of each search."""
    names, order, clear = tuple(searches.limits), searches.order, searches.is_clearance
    nodes = curves.samples(GRID[:, None], order)
    rows = [np.broadcast_to(nodes.value(name), (NODES, searches.count)) for name in names]
    largest = np.full(searches.count, ABSENT)
    for g in rows:
        largest = np.maximum(largest, g.max(axis=0))
    found = []
    for k, (name, g) in enumerate(zip(names, rows, strict=True)):
        # A small obstacle may be between two nodes, and the peak at a corner of walls is narrow.
        least, rounds = (-np.inf, CORNER if searches.by_walls(name) else 1) if clear[k] else (RELEVANT, 1)
        places = (highest(g, GRID, least), OFFSETS), (sharp(name, curves, nodes, searches.count), NARROW)
        tops = [
            (candidates.owner, *refined(name, curves.at(candidates.owner), candidates, offsets, rounds))
            for candidates, offsets in places
            if candidates.owner.size
        ]
        if tops:
            owner, time, value = _distinct(*(np.concatenate(x) for x in zip(*tops, strict=True)))
            found.append((owner, k, time, value, False, False))
            np.maximum.at(largest, owner, value)
    for k, g in enumerate(rows):
        owner, time, value = _at_fixed_times(g, largest)
        found.append((owner, k, time, value, True, False))
    travelled = [Travelled(curves, searches.count)] if searches.zones else []
    for k, zone in enumerate(searches.zones, len(names)):
        own, parts = zone_peaks(zone, curves, *travelled)
        largest = np.maximum(largest, own)
        found += [(part.owner, k, part.time, part.value, part.fixed, part.edge) for part in parts]
    columns = zip(*(np.broadcast_arrays(*x) for x in found), strict=True)
    least = np.where(clear, RELEVANT_CLEARANCE, RELEVANT)
    return _ranked(least, *(np.concatenate(x) for x in columns)), largest


def largest_values(searches: Searches, z: Float[np.ndarray, "n batch"]) -> Float[np.ndarray, "limits batch"]:
    """Return the largest constraint value of each constant limit."""
    with np.errstate(all="ignore"):
        curves = Curves(searches, z)
        peaks, _ = find_peaks(searches, curves)
        rows = curves.values(tuple(searches.limits), GRID[:, None], searches.order)
        result = np.array([np.broadcast_to(g, (NODES, searches.count)).max(axis=0) for g in rows])
        own = peaks.limit < len(result)
        np.maximum.at(result, (peaks.limit[own], peaks.owner[own]), peaks.value[own])
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


def _ranked(
    least: np.ndarray, owner: np.ndarray, limit: np.ndarray, time: np.ndarray, value: np.ndarray, *marks: np.ndarray
) -> Peaks:
    """Return the relevant peaks in descending order of each search, without those beyond the maximum number.

    `least` is the smallest relevant value of each limit.
    """
    order = np.flatnonzero(value > least[limit])
    order = order[np.lexsort((-value[order], owner[order]))]
    owner = owner[order]
    first = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]])[: owner.size])
    rank = np.arange(owner.size) - np.repeat(first, np.diff(np.append(first, owner.size)))
    kept = rank < MAX_PEAKS
    parts = (limit, time, value, *marks)
    return Peaks(owner[kept], rank[kept], *(x[order][kept] for x in parts))


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
