"""Certify limits on a route, segment by segment, and locate the intervals of violation."""

from typing import Any

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import BROKEN, Certificate
from qtraj.design.proof.judge import Limit
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.proof.route_segments import findings, worst
from qtraj.foundation.arrays import is_traced
from qtraj.path.driving import require_one_direction, segments_of
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity
from qtraj.path.route import Route
from qtraj.path.stops import Segments
from qtraj.path.vehicle import RoadParameters

INSTANTS = 65
"""A quantity is evaluated at this number of equally spaced instants in each segment that violates its limit."""

PARTS, DIVISIONS = 16, 13
"""Number of parts into which each step of the search for a crossing divides the interval, and number of steps."""

SHORT = 1e-9
"""An interval shorter than this fraction of its segment is ignored as a rounding error, unless it contains the peak.
Close to a stop, rounding errors dominate the velocity and its direction."""


def certify_route(route: Route, limits: Limits) -> RouteCertificate:
    """Return the certificate of one `route` for `limits`; see `certify`.

    **Raises:** ValueError for a batch of routes, inside a trace, and for limits on forces on a banked road if the route
    reverses.
    """
    if route.duration.ndim or is_traced(route, limits):
        raise ValueError(
            "certify accepts one route with concrete values: call it outside jit, grad and vmap, once for each route"
        )
    limits.require_batch((), "the route")
    if limits.on_road:
        require_one_direction(route, limits.vehicle)
    bounds_by_name = {name: float(np.asarray(x)) for name, x in limits.given().items()}
    segments = segments_of(route)
    count, starts = len(segments.starts), segments.starts
    names, bounds = tuple(bounds_by_name), np.array([*bounds_by_name.values()])
    if not names:
        no_limits, no_findings = np.zeros(0), np.zeros((count, 0))
        whole = Certificate((), *[no_limits] * 4)
        return RouteCertificate(whole, Certificate((), *[no_findings] * 4), starts)
    road = limits.road(float) if limits.on_road else None
    factors = np.array([float(np.asarray(x)) for x in limits.factors(float)])
    results = findings(segments, [Limit(quantity(n), *x) for n, *x in zip(names, bounds, factors, strict=True)], road)
    times = results.times + starts[:, None]
    codes, column = worst(results.codes), np.arange(len(names))
    side = np.array([quantity(name).side for name in names])
    candidates = np.where(results.codes == codes[None], side * results.values, -np.inf)
    row = np.argmax(np.where(np.isnan(candidates), np.inf, candidates), axis=0)
    whole = Certificate(names, codes, times[row, column], results.values[row, column], bounds)
    parts = Certificate(names, results.codes, times, results.values, np.broadcast_to(bounds, results.codes.shape))
    broken, broken_limits = [], []
    for k, name in enumerate(names):
        rows = np.flatnonzero(results.codes[:, k] == BROKEN)
        bound = bounds[k] / factors[k]
        intervals = _intervals(segments, name, bound, road, rows, results.times[rows, k])
        broken += intervals
        broken_limits += [k] * len(intervals)
    return RouteCertificate(whole, parts, starts, broken, broken_limits)


def _intervals(
    segments: Segments, name: str, bound: float, road: RoadParameters | None, rows: np.ndarray, peaks: np.ndarray
) -> list[tuple[float, float]]:
    """Return the intervals in which a quantity violates its bound, in the segments `rows`.

    `peaks` are times at which the quantity violates its bound, one per segment, measured from the start of the segment.
    """
    if not rows.size:
        return []
    own = segments.part(rows)
    h, every = own.durations, np.arange(len(rows))[:, None]
    s = np.sort(np.concatenate([h[:, None] * np.linspace(0.0, 1.0, INSTANTS), peaks[:, None]], axis=1), axis=1)
    parked: Any = ~own.coefficients[:, 1:].any(axis=(1, 2))
    above = _exceeds(own.values, every, s, name, bound, road) | (s == peaks[:, None]) | parked[:, None]
    row, left = np.nonzero(above[:, 1:] != above[:, :-1])
    low, high, first = s[row, left], s[row, left + 1], above[row, left]
    u = np.arange(1, PARTS) / PARTS
    for _ in range(DIVISIONS):
        width = high - low
        inner = low[:, None] + width[:, None] * u
        same = _exceeds(own.values, row[:, None], inner, name, bound, road) == first[:, None]
        count = np.sum(np.logical_and.accumulate(same, axis=1), axis=1)
        low, high = low + width * count / PARTS, np.where(count == PARTS - 1, high, low + width * (count + 1) / PARTS)
    intervals: list[tuple[float, float]] = []
    for i, start in enumerate(segments.starts[rows]):
        inner = start + np.where(first, low, high)[row == i]
        edges = [*([start] if above[i, 0] else []), *inner, *([start + h[i]] if above[i, -1] else [])]
        peak, shortest = start + peaks[i], SHORT * h[i]
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if b - a < shortest and not a - shortest <= peak <= b + shortest:
                continue
            if intervals and a <= intervals[-1][1]:
                intervals[-1] = (intervals[-1][0], float(b))
            else:
                intervals.append((float(a), float(b)))
    return intervals


def _exceeds(
    values: Any, rows: np.ndarray, s: np.ndarray, name: str, bound: float, road: RoadParameters | None
) -> np.ndarray:
    """Check whether a quantity violates its bound in the segments `rows` (n, 1) at the times `s` (n, instants).

    The times are measured from the start of the segment, and `values` returns the derivatives.
    """
    entry = quantity(name)
    derivatives = values(np.broadcast_to(rows, s.shape), s, max(entry.order, 1))
    components: list[Any] = [(r[..., 0], r[..., 1], r[..., 2]) for r in derivatives]
    return np.asarray(entry.exceeds(Invariants(components, vehicle=road, root=np.sqrt), bound))
