"""Findings on limits that change along the way: in parts of the segments of a path with constant bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.along import Along
from qtraj.design.proof.certificate import BROKEN, UNDECIDED
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.route_segments import RANK
from qtraj.design.varying import Varying
from qtraj.design.windows import windows
from qtraj.path.angle import gap_of_line
from qtraj.path.distances import Distances
from qtraj.path.path_quantity import PathQuantity

ACCURATE, HALVINGS, MOST = 1e-7, 8, 2**14
"""Parts of a linear limit are halved, at most `HALVINGS` times, until lines approximate it to this relative accuracy. A
limit has at most `MOST` parts."""

LEAST = float(np.finfo(float).tiny)


class Divided(NamedTuple):
    """A path that consists of segments, with the distances along it.

    `starts` and `durations` (n,) [s] are those of the segments. `findings` returns the findings on a limit in the given
    segments (m,), restricted to a window of each.
    """

    starts: Float[np.ndarray, " n"]
    durations: Float[np.ndarray, " n"]
    distances: Distances
    findings: Callable[[Int[np.ndarray, " m"], Limit, Window], Findings]


class Parts(NamedTuple):
    """Parts of segments, in which one limit is constant or linear, and the findings on them.

    `bounds` are those where they matter most, and `line` those at both ends of each part. The times [s] are measured
    from the start of the segment.
    """

    segment: Int[np.ndarray, " parts"]
    window: Window
    bounds: Float[np.ndarray, " parts"]
    line: Float[np.ndarray, "parts 2"]
    codes: Int[np.ndarray, " parts"]
    times: Float[np.ndarray, " parts"]
    values: Float[np.ndarray, " parts"]

    def worst(self, entry: PathQuantity, count: int) -> Int[np.ndarray, " segments"]:
        """Return for each of `count` segments its part with the worst finding, or −1 for a segment without a limit."""
        value = excess(entry.side, self.values, self.bounds)
        order = np.lexsort([np.where(np.isnan(value), np.inf, value), RANK[self.codes], self.segment])
        result = np.full(count, -1)
        result[self.segment[order]] = order  # the last one of each segment remains
        return result


def excess(side: int | np.ndarray, values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return the distances of values from bounds, relative to the largest bound; positive where a bound is violated.

    The result is −inf without a bound.
    """
    size = np.max(np.where(np.isfinite(bounds), np.abs(bounds), 0.0), axis=0, initial=LEAST)
    with np.errstate(invalid="ignore", over="ignore"):
        found = side * (values - bounds) / size
    return np.where(np.isinf(bounds), -np.inf, found)


def judged_parts(path: Divided, entry: PathQuantity, along: Along, factor: float) -> Parts:
    """Return the findings on one limit in all parts of the path; `factor` is that of the quantity."""
    limit = Varying(along, path.distances, entry.side)
    segment, window, bounds = _cut(path, *windows(limit))
    line = None
    if along.kind == "linear":
        segment, window, line = _lines(path, limit, entry, segment, window)
        bounds = entry.side * np.min(entry.side * line, axis=1)
    found = path.findings(segment, Limit(entry, bounds, np.asarray(factor), line), window)
    ends = np.stack([bounds, bounds], axis=1) if line is None else line
    parts = Parts(segment, window, bounds, ends, *(x[:, 0] for x in found))
    return parts if line is None else _with_values(path, parts, limit)


def _lines(
    path: Divided, limit: Varying, entry: PathQuantity, segment: np.ndarray, window: Window
) -> tuple[np.ndarray, Window, Float[np.ndarray, "parts 2"]]:
    """Return smaller parts, in which lines approximate a linear limit, and the lines."""
    for _ in range(HALVINGS):
        low, high = (path.starts[segment] + x * path.durations[segment] for x in window)
        line, rest = limit.approximated(low, high)
        if entry.tangent_of:
            rest = rest + gap_of_line(line, entry.tangent_of)
        rough = rest > ACCURATE * np.abs(line).max(axis=1)
        if not rough.any() or segment.size + np.count_nonzero(rough) > MOST:
            break
        count = 1 + rough
        middle = 0.5 * (window.start + window.end)
        first = np.cumsum(count) - count
        start, end = (np.repeat(x, count) for x in window)
        end[first[rough]] = start[first[rough] + 1] = middle[rough]
        segment, window = np.repeat(segment, count), Window(start, end)
    low, high = (path.starts[segment] + x * path.durations[segment] for x in window)
    return segment, window, limit.lines(low, high)


def _with_values(path: Divided, parts: Parts, limit: Varying) -> Parts:
    """Return the parts with the values of a linear limit; UNDECIDED where only the line of a part is violated."""
    bounds = limit.at(path.starts[parts.segment] + parts.times)
    within = (parts.codes == BROKEN) & ~(limit.side * (parts.values - bounds) > 0)
    return parts._replace(codes=np.where(within, UNDECIDED, parts.codes), bounds=bounds)


def _cut(
    path: Divided, low: np.ndarray, high: np.ndarray, bounds: np.ndarray
) -> tuple[Int[np.ndarray, " parts"], Window, Float[np.ndarray, " parts"]]:
    """Return the parts of segments that intervals of time cover, and their bounds."""
    starts, ends = path.starts, path.starts + path.durations
    first = np.clip(np.searchsorted(starts, low, side="right") - 1, 0, len(starts) - 1)
    last = np.maximum(np.searchsorted(starts, high, side="left") - 1, first)
    count = last - first + 1
    owner = np.repeat(np.arange(len(low)), count)
    segment = first[owner] + np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
    span = path.durations[segment]
    start = np.where(low[owner] <= starts[segment], 0.0, (low[owner] - starts[segment]) / span)
    end = np.where(high[owner] >= ends[segment], 1.0, (high[owner] - starts[segment]) / span)
    return segment, Window(np.clip(start, 0.0, 1.0), np.clip(end, 0.0, 1.0)), bounds[owner]
