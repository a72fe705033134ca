"""Locate the intervals of a route in which a quantity violates its limit."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra import bernstein
from qtraj.design.ellipse import OfSpeed
from qtraj.design.proof.speed_claims import compared
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.stops import Segments

INSTANTS = 65
"""A quantity is evaluated at this number of equally spaced instants in each segment that violates its limit."""

PARTS, DIVISIONS = 16, 13
"""Number of parts into which each step of the search for a crossing divides the interval, and number of steps."""

SHORT = 1e-9
"""An interval shorter than this fraction of its segment is ignored as a rounding error, unless it contains the peak.
Close to a stop, rounding errors dominate the velocity and its direction."""


class Intervals(NamedTuple):
    """Parts of segments, from `start` to `end` [s], in which a quantity violates its bound at the time `peak` [s].

    The bound has these Bernstein coefficients, unless it depends on the speed. All times are measured from the start of
    the segment.
    """

    segment: Int[np.ndarray, " n"]
    start: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]
    bound: Float[np.ndarray, "n terms"]
    peak: Float[np.ndarray, " n"]
    by_speed: OfSpeed | None = None

    def bound_at(self, part: Int[np.ndarray, "n 1"], s: Float[np.ndarray, "n times"]) -> Float[np.ndarray, "n times"]:
        """Return the bounds of some parts at times since the starts of their segments."""
        part = np.broadcast_to(part, s.shape)
        length = np.maximum(self.end - self.start, np.finfo(float).tiny)[part]
        place = (s - self.start[part]) / length
        return bernstein.values(self.bound[part.ravel()], place.ravel()).reshape(s.shape)


def intervals(
    segments: Segments, name: str, parts: Intervals, road: RoadParameters | RoadOnPath | None
) -> list[tuple[float, float]]:
    """Return the intervals (start, end) [s] of a route in which a quantity violates its bound."""
    if not parts.segment.size:
        return []
    own, peaks = segments.part(parts.segment), parts.peak
    h, every = parts.end - parts.start, np.arange(len(peaks))[:, None]
    s = parts.start[:, None] + h[:, None] * np.linspace(0.0, 1.0, INSTANTS)
    s = np.sort(np.concatenate([s, peaks[:, None]], axis=1), axis=1)
    parked: Any = ~own.coefficients[:, 1:].any(axis=(1, 2))

    def exceeds(part: np.ndarray, s: np.ndarray) -> np.ndarray:
        if parts.by_speed is not None:
            return _exceeds_by_speed(own, part, s, name, parts.by_speed)
        return _exceeds(own, part, s, name, parts.bound_at(part, s), road)

    above = exceeds(every, s) | (s == peaks[:, None]) | parked[:, None]
    row, left = np.nonzero(above[:, 1:] != above[:, :-1])
    low, high, first = s[row, left], s[row, left + 1], above[row, left]
    u = np.arange(1, PARTS) / PARTS
    for _ in range(DIVISIONS):
        width = high - low
        inner = low[:, None] + width[:, None] * u
        same = exceeds(row[:, None], inner) == first[:, None]
        count = np.sum(np.logical_and.accumulate(same, axis=1), axis=1)
        low, high = low + width * count / PARTS, np.where(count == PARTS - 1, high, low + width * (count + 1) / PARTS)
    found: list[tuple[float, float]] = []
    for i, start in enumerate(own.starts):
        inner = start + np.where(first, low, high)[row == i]
        first_edge, last_edge = [start + parts.start[i]], [start + parts.end[i]]
        edges = [*(first_edge if above[i, 0] else []), *inner, *(last_edge if above[i, -1] else [])]
        peak, shortest = start + peaks[i], SHORT * h[i]
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if b - a < shortest and not a - shortest <= peak <= b + shortest:
                continue
            if found and a <= found[-1][1]:
                found[-1] = (found[-1][0], max(float(b), found[-1][1]))
            else:
                found.append((float(a), float(b)))
    return found


def _exceeds(
    segments: Segments, rows: np.ndarray, s: np.ndarray, name: str, bound: np.ndarray, road: Any
) -> np.ndarray:
    """Check whether a quantity violates its bound in the segments `rows` (n, 1) at the times `s` (n, instants).

    The times are measured from the start of the segment.
    """
    entry = quantity(name)
    derivatives = segments.values(np.broadcast_to(rows, s.shape), s, max(entry.order, 1))
    if segments.origin is not None:
        derivatives[0] = derivatives[0] + segments.origin
    components: list[Any] = [(r[..., 0], r[..., 1], r[..., 2]) for r in derivatives]
    if isinstance(road, RoadOnPath):
        road = road.at(segments.starts[rows] + s)
    return np.asarray(entry.exceeds(Invariants(components, vehicle=road, root=np.sqrt), bound))


def _exceeds_by_speed(segments: Segments, rows: np.ndarray, s: np.ndarray, name: str, bound: OfSpeed) -> np.ndarray:
    """Check whether a quantity violates a limit that depends on the speed; the arguments are those of `_exceeds`."""
    derivatives = segments.values(np.broadcast_to(rows, s.shape), s, 2)
    i = Invariants([(r[..., 0], r[..., 1], r[..., 2]) for r in derivatives])
    value, limit = compared(i, name, bound)
    return np.asarray(quantity(name).side * (value - limit) > 0)
