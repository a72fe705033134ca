"""Compute the findings on each segment of a route, including segments that start or end at a stop.

Next to a stop, quantities that depend only on the direction of the velocity, and components of the acceleration, are
computed from a vector in the direction of the velocity (see `standing`). This is impossible for the curvature and other
quantities of the shape, which are unbounded near a stop unless the path is straight there, or the segment is a curve
with a progress (see `composed`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from qtraj.design.proof.at_rest import at_rest
from qtraj.design.proof.certificate import UNDEFINED
from qtraj.design.proof.composed import composed_source, fractions_along, times_along
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.judge import judge
from qtraj.design.proof.sources import PolynomialSource, Source
from qtraj.design.proof.standing import standing, standing_source
from qtraj.path.moment_quantities import MOMENTS
from qtraj.path.quantity import COMBINED, QUANTITIES
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.stops import Segments

DIRECTIONS = ("slope", "angular_rate", "angular_acceleration", "yaw_rate", "yaw_acceleration", *MOMENTS)
"""Quantities that depend only on the direction of the velocity."""

COMPONENTS = (
    "lateral_acceleration",
    "longitudinal_acceleration",
    COMBINED,
    *(name for name, entry in QUANTITIES.items() if entry.gravity),
)
"""Components of the acceleration along and across the velocity, and quantities that depend on road or gravity."""

BLOCK_SIZE = 1024
"""Number of segments that are judged together; larger blocks leave the cache, and smaller ones need more calls."""

RANK = np.array([0, 1, 4, 2, 3])
"""The rank of each code, from the best to the worst: proved, sampled, undecided, undefined, broken."""


def findings(
    segments: Segments,
    limits: Sequence[Limit],
    road: RoadParameters | None,
    window: Window | None = None,
    end: RoadParameters | None = None,
) -> Findings:
    """Compute the findings on every segment; the times are measured from the start of the segment.

    Each of `limits` has one bound and one factor, or one for each segment, and `road` contains the parameters of the
    vehicle, or those for each segment, or is None. With a `window`, the findings are on a part of each segment; the
    parameters are linear in it up to those at its `end`, if these are given.
    """
    count, moving = len(segments.durations), segments.coefficients[:, 1:].any(axis=(1, 2))
    stops, composed = standing(segments), segments.composed & moving
    result = Findings(*(np.zeros((count, len(limits)), dtype) for dtype in (np.int32, float, float)))
    stopping = stops.any(axis=1) & ~composed
    regular, stopping = moving & ~stopping & ~composed, np.flatnonzero(stopping)
    every = np.arange(len(limits))
    task = _Task(segments, limits, road, window, end)
    _judge(result, task, np.flatnonzero(regular), every, _regular)
    kinds = np.array([_kind(limit) for limit in limits])
    _judge(result, task, stopping, every[kinds == "path"], _regular)
    for kind, keep in (("direction", False), ("component", True)):
        source = lambda segments, rows, keep=keep: standing_source(segments, rows, keep)  # noqa: E731
        _judge(result, task, stopping, every[kinds == kind], source)
    for kind in ("path", "direction", "component", "shape"):
        source = lambda segments, rows, kind=kind: composed_source(segments, rows, kind)  # noqa: E731
        own = task
        if kind == "shape" and window is not None and composed.any():
            # A function of the time is another one along the curve.
            constant = [limit._replace(curve=None) for limit in limits]
            own = task._replace(window=Window(*(fractions_along(segments, x) for x in window)), limits=constant)
        _judge(result, own, np.flatnonzero(composed), every[kinds == kind], source)
    on_curve = np.ix_(composed, kinds == "shape")
    fractions = result.times[on_curve] / segments.durations[composed][:, None]
    result.times[on_curve] = times_along(segments, np.flatnonzero(composed), fractions)
    at_stop = stops[stopping]
    if window is not None:
        at_stop = at_stop & np.stack([window.start == 0, window.end == 1], axis=1)[stopping]
    within = at_stop.any(axis=1)
    undefined = np.ix_(stopping[within], every[kinds == "shape"])
    result.codes[undefined], result.values[undefined] = UNDEFINED, np.nan
    result.times[undefined] = np.where(at_stop[:, 0], 0.0, segments.durations[stopping])[within, None]
    _judge(result, task, stopping[~within], every[kinds == "shape"], _regular)
    result.codes[~moving], result.values[~moving] = at_rest(segments, limits, road, np.flatnonzero(~moving))
    return result


def _kind(limit: Limit) -> str:
    """Return how the limit is judged next to a stop."""
    if limit.entry.own is not None:
        return limit.entry.own.stop
    if limit.entry.divisor is None:
        return "path"
    name = limit.entry.base or limit.entry.name
    if name in DIRECTIONS:
        return "direction"
    if name in COMPONENTS:
        return "component"
    return "path" if limit.entry.per_time else "shape"


class _Task(NamedTuple):
    """The arguments of `findings`."""

    segments: Segments
    limits: Sequence[Limit]
    road: RoadParameters | None
    window: Window | None
    end: RoadParameters | None


def _judge(result: Findings, task: _Task, rows: np.ndarray, columns: np.ndarray, source: Any) -> None:
    """Store the findings on the given rows and columns in `result`."""
    if not columns.size:
        return
    count = len(result.codes)
    for start in range(0, len(rows), BLOCK_SIZE):
        block = rows[start : start + BLOCK_SIZE]
        own = [_of_rows(task.limits[k], count, block) for k in columns]
        vehicle, end = (_parameters(x, count, block) for x in (task.road, task.end))
        window = None if task.window is None else Window(*(x[block] for x in task.window))
        found = judge(source(task.segments, block), own, vehicle, window, end)
        for array, new in zip(result, found, strict=True):
            array[np.ix_(block, columns)] = new


def _parameters(road: RoadParameters | None, count: int, rows: np.ndarray) -> RoadParameters | None:
    """Return the parameters in some of `count` rows."""
    return None if road is None else road.each(lambda x: np.broadcast_to(np.asarray(x, float), count)[rows])


def _of_rows(limit: Limit, count: int, rows: np.ndarray) -> Limit:
    """Return the limit in some of `count` rows."""
    bounds, factors = (np.broadcast_to(x, count)[rows] for x in (limit.bounds, limit.factors))
    return Limit(limit.entry, bounds, factors, None if limit.curve is None else limit.curve[rows], limit.by_speed)


def _regular(segments: Segments, rows: np.ndarray) -> Source:
    c = segments.coefficients[rows]
    x, y, z = (np.ascontiguousarray(c[:, :, axis].T) for axis in range(3))
    return PolynomialSource(x, y, z, None, segments.durations[rows], origin=segments.origin)


def worst(codes: Int[np.ndarray, "segments limits"]) -> Int[np.ndarray, " limits"]:
    """Return the status code of each limit for the whole route, which is the worst code of all segments."""
    row = np.argmax(RANK[codes], axis=0)
    return codes[row, np.arange(codes.shape[1])]
