"""Findings on limits that change along the way: in parts of the segments of a path with constant bounds."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.along import Along
from qtraj.design.proof.certificate import BROKEN, UNDECIDED
from qtraj.design.proof.judge import Findings, Limit, Window
from qtraj.design.proof.route_segments import RANK
from qtraj.design.windows import windows
from qtraj.path.distances import Distances
from qtraj.path.path_quantity import PathQuantity

FINER, ROUNDS = 16, 2
"""A linear limit that is not proved in a part is checked in `FINER` parts of it; this is repeated `ROUNDS` times."""

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
    """Parts of segments in which one limit is constant, and the findings on them.

    The times [s] are measured from the start of the segment.
    """

    segment: Int[np.ndarray, " parts"]
    window: Window
    bounds: Float[np.ndarray, " parts"]
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
    """Return the relative distances of values from bounds, positive where a bound is violated; −inf without a bound."""
    with np.errstate(invalid="ignore"):
        found = side * (values - bounds) / np.maximum(np.abs(bounds), LEAST)
    return np.where(np.isinf(bounds), -np.inf, found)


def judged_parts(path: Divided, entry: PathQuantity, along: Along, factor: float) -> Parts:
    """Return the findings on one limit in all parts of the path; `factor` is that of the quantity."""
    task = _Task(path, entry, along, np.asarray(factor))
    parts = task.judged(*_cut(path, *windows(along, path.distances, entry.side)))
    if along.kind == "step":
        return parts
    for _ in range(ROUNDS):
        open_ = (parts.codes >= BROKEN) & (parts.window.end > parts.window.start)
        if not open_.any():
            break
        parts = task.refined(parts, open_)
    return task.decided(parts)


class _Task(NamedTuple):
    """One limit on a path."""

    path: Divided
    entry: PathQuantity
    along: Along
    factor: np.ndarray

    def judged(self, segment: np.ndarray, window: Window, bounds: np.ndarray) -> Parts:
        """Return the findings on parts of segments."""
        found = self.path.findings(segment, Limit(self.entry, bounds, self.factor), window)
        return Parts(segment, window, bounds, *(x[:, 0] for x in found))

    def refined(self, parts: Parts, which: np.ndarray) -> Parts:
        """Judge some parts again, each divided into smaller ones."""
        steps, path = np.linspace(0.0, 1.0, FINER + 1), self.path
        segment = np.repeat(parts.segment[which], FINER)
        ends = Window(*(x[which] for x in parts.window)).at(steps[:, None]).T
        window = Window(ends[:, :-1].ravel(), ends[:, 1:].ravel())
        low, high = (path.distances.at(path.starts[segment] + x * path.durations[segment]) for x in window)
        error = path.distances.uncertainty
        finer = self.judged(
            segment, window, np.asarray(self.along.strictest(low - error, high + error, self.entry.side))
        )
        kept = [x[~which] for x in (parts.segment, *parts.window, *parts[2:])]
        fields = zip(kept, (finer.segment, *finer.window, *finer[2:]), strict=True)
        own, start, end, *rest = (np.concatenate(x) for x in fields)
        return Parts(own, Window(start, end), *rest)

    def decided(self, parts: Parts) -> Parts:
        """Replace BROKEN by UNDECIDED where only the strictest value in a part of a linear limit is violated."""
        at = self.path.distances.at(self.path.starts[parts.segment] + parts.times)
        bounds = np.asarray(self.along.at(at))
        only_strictest = (parts.codes == BROKEN) & ~(self.entry.side * (parts.values - bounds) > 0)
        return parts._replace(codes=np.where(only_strictest, UNDECIDED, parts.codes), bounds=bounds)


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
