"""Findings on limits that change along the way, in parts of segments that have one polynomial as their bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.along import Along
from qtraj.design.limit_curves import ACCURATE, TERMS, curves
from qtraj.design.proof.certificate import BROKEN, UNDECIDED
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.route_segments import RANK
from qtraj.design.varying import Varying
from qtraj.design.windows import windows
from qtraj.path.angle import gap_of_curve
from qtraj.path.distances import Distances
from qtraj.path.path_quantity import PathQuantity

HALVINGS, MOST = 20, 2**14
"""Parts of a linear limit are halved, at most `HALVINGS` times, until polynomials approximate it accurately. A limit
has at most `MOST` parts."""

CONSTANT_HALVINGS, CONSTANT_ACCURATE = 8, 1e-7
"""The same, and the relative accuracy, where constants approximate it."""

LEAST = float(np.finfo(float).tiny)


class Divided(NamedTuple):
    """A path that consists of segments, with the distances along it.

    `starts` and `durations` (n,) [s] are those of the segments. `findings` returns the findings on a limit in the given
    segments (m,), restricted to a window of each. `constant` are the segments in which limits on the shape are compared
    to the strictest value in the window.
    """

    starts: Float[np.ndarray, " n"]
    durations: Float[np.ndarray, " n"]
    distances: Distances
    findings: Callable[[Int[np.ndarray, " m"], Limit, Window], Findings]
    constant: Bool[np.ndarray, " n"] | None = None


class Parts(NamedTuple):
    """Parts of segments, in which one limit is constant or a polynomial, and the findings on them.

    `bounds` are those where they matter most, and `curve` are their Bernstein coefficients in each part. The times [s]
    are measured from the start of the segment.
    """

    segment: Int[np.ndarray, " parts"]
    window: Window
    bounds: Float[np.ndarray, " parts"]
    curve: Float[np.ndarray, "parts terms"]
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
    curve = None
    if along.kind == "linear":
        segment, window, curve = _curves(path, limit, entry, segment, window)
        bounds = entry.side * np.min(entry.side * curve, axis=1)
    found = path.findings(segment, Limit(entry, bounds, np.asarray(factor), curve), window)
    own = bounds[:, None] if curve is None else curve
    parts = Parts(segment, window, bounds, own, *(x[:, 0] for x in found))
    return parts if curve is None else _with_values(path, parts, limit)


def _curves(
    path: Divided, limit: Varying, entry: PathQuantity, segment: np.ndarray, window: Window
) -> tuple[np.ndarray, Window, Float[np.ndarray, "parts terms"]]:
    """Return smaller parts, in which polynomials approximate a linear limit, and the polynomials."""
    coefficients = np.zeros((0, TERMS))
    for k in range(HALVINGS + 1):
        low, high = (path.starts[segment] + x * path.durations[segment] for x in window)
        coefficients, _, rough = curves(limit, low, high)
        size = np.abs(coefficients).max(axis=1)
        if entry.tangent_of:
            rough = rough | (gap_of_curve(coefficients, entry.tangent_of, entry.side) > ACCURATE * size)
        if path.constant is not None and entry.of_shape and k < CONSTANT_HALVINGS:
            spread = np.ptp(coefficients, axis=1)
            rough = rough | (path.constant[segment] & (spread > CONSTANT_ACCURATE * size))
        if k == HALVINGS or not rough.any() or segment.size + np.count_nonzero(rough) > MOST:
            break
        count = 1 + rough
        middle = 0.5 * (window.start + window.end)
        first = np.cumsum(count) - count
        start, end = (np.repeat(x, count) for x in window)
        end[first[rough]] = start[first[rough] + 1] = middle[rough]
        segment, window = np.repeat(segment, count), Window(start, end)
    return segment, window, coefficients


def _with_values(path: Divided, parts: Parts, limit: Varying) -> Parts:
    """Return the parts with the values of a linear limit; UNDECIDED where only the polynomial of a part is violated."""
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
