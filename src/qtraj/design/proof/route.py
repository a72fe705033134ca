"""Certify limits on a route, segment by segment."""

from typing import Any, NamedTuple

import numpy as np

from qtraj.design.divisors import factors as factors_of
from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.margins import at_speed
from qtraj.design.proof.certificate import BROKEN, PROVED, Certificate
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.on_road import OnRoad
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.proof.route_intervals import Intervals, intervals
from qtraj.design.proof.route_segments import findings, worst
from qtraj.design.proof.traced_route import certify_traced
from qtraj.design.proof.varying import limit_by_speed
from qtraj.design.proof.varying_parts import Divided, excess, judged_parts
from qtraj.foundation.arrays import is_traced
from qtraj.path.distances import Distances, distances
from qtraj.path.driving import require_one_direction, segments_of
from qtraj.path.quantity import quantity
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.route import Route
from qtraj.path.stops import Segments
from qtraj.path.vehicle import fixed_parameters


def certify_route(route: Route, limits: Limits) -> RouteCertificate:
    """Return the certificate of one `route` for `limits`; see `certify`.

    **Raises:** ValueError for a batch of routes, for limits on forces on a banked road if the route reverses, and
    inside a trace for limits that are not constant.
    """
    if route.duration.ndim:
        raise ValueError("certify accepts one route: call it once for each route, or map it with jax.vmap")
    limits.require_batch((), "the route")
    if is_traced(route, limits):
        return certify_traced(route, limits, certify_route)
    if limits.on_forces:
        require_one_direction(route, limits.vehicle)
    limits = limits.on(route)
    segments, given = segments_of(route), limits.given()
    count, starts, names = len(segments.starts), segments.starts, tuple(given)
    if not names:
        no_limits, no_findings = np.zeros(0), np.zeros((count, 0))
        whole = Certificate((), *[no_limits] * 4)
        return RouteCertificate(whole, Certificate((), *[no_findings] * 4), starts)
    road, on_road = fixed_parameters(limits.vehicle, float) if limits.uses_vehicle else None, limits.along_road
    factors = dict(zip(names, (float(np.asarray(x)) for x in factors_of(limits, float)), strict=True))
    numbers = {name: float(np.asarray(x)) for name, x in limits.constant().items()}
    constant = {name: x for name, x in numbers.items() if name not in on_road}
    found = [_of_constant(segments, constant, factors, road)] if constant else []
    by_speed = {name: x for name, x in given.items() if isinstance(x, OfSpeed)}
    found += [_by_speed(segments, name, x) for name, x in by_speed.items()]
    if along := [name for name in dict.fromkeys([*limits.varying, *on_road]) if name not in by_speed]:
        on = distances(route)
        vehicle: Any = limits.vehicle
        way = RoadOnPath(vehicle, on) if on_road else None
        divided = _divided(on, segments, road, way)
        for name in along:
            own = way if way is not None and name in on_road else road
            if name in limits.varying:
                found.append(_of_varying(divided, segments, name, given[name], factors[name], own))
            else:
                found.append(_on_road(divided, segments, name, numbers[name], own))
    return _certificate(starts, names, found)


class _Found(NamedTuple):
    """Findings on limits: the codes, times [s], values and limits (segments, k), and the intervals of violation."""

    names: tuple[str, ...]
    arrays: tuple[np.ndarray, ...]
    broken: list[tuple[str, tuple[float, float]]]


def _of_constant(
    segments: Segments, bounds: dict[str, float], factors: dict[str, float], road: RoadParameters | None
) -> _Found:
    """Return the findings on limits that do not change along the way."""
    names = tuple(bounds)
    limits = [Limit(quantity(name), np.asarray(bounds[name]), np.asarray(factors[name])) for name in names]
    codes, times, values = findings(segments, limits, road)
    broken = []
    for k, name in enumerate(names):
        rows = np.flatnonzero(codes[:, k] == BROKEN)
        ends = segments.durations[rows]
        bound = np.full((rows.size, 2), bounds[name] / factors[name])
        parts = Intervals(rows, 0.0 * ends, ends, bound, times[rows, k])
        broken += [(name, x) for x in intervals(segments, name, parts, road)]
    own = np.broadcast_to(list(bounds.values()), codes.shape)
    return _Found(names, (codes, times + segments.starts[:, None], values, own), broken)


def _by_speed(segments: Segments, name: str, bound: OfSpeed) -> _Found:
    """Return the findings on a limit that depends on the speed."""
    codes, times, values = findings(segments, [limit_by_speed(name, bound)], None)
    velocity = segments.values(np.arange(len(times)), times[:, 0], 1)[1]
    bounds = np.asarray(at_speed(bound, np.linalg.norm(velocity, axis=-1)), float)
    rows = np.flatnonzero(codes[:, 0] == BROKEN)
    ends = segments.durations[rows]
    parts = Intervals(rows, 0.0 * ends, ends, np.zeros((rows.size, 2)), times[rows, 0], bound)
    broken = [(name, x) for x in intervals(segments, name, parts, None)]
    return _Found((name,), (codes, times + segments.starts[:, None], values, bounds[:, None]), broken)


def _divided(on: Distances, segments: Segments, road: RoadParameters | None, way: RoadOnPath | None) -> Divided:
    """Return the segments; `way` is the road of limits on forces, if it changes along the way."""

    def judged(segment: np.ndarray, limit: Limit, window: Window, start: Any, end: Any = None) -> Findings:
        return findings(segments.part(segment), [limit], start, window, end)

    ends = np.minimum(segments.starts + segments.durations, np.append(segments.starts[1:], np.inf))
    on_road = None if way is None else OnRoad(way, segments.starts, ends, judged)

    def of_parts(segment: np.ndarray, limit: Limit, window: Window) -> Findings:
        if on_road is not None and on_road.supports(limit.entry):
            return on_road.findings(segment, limit, window)
        return judged(segment, limit, window, road)

    return Divided(segments.starts, segments.durations, on, of_parts, segments.composed)


def _on_road(divided: Divided, segments: Segments, name: str, bound: float, way: Any) -> _Found:
    """Return the findings on a constant limit on a road that changes along the way."""
    count, ends = len(segments.starts), segments.durations
    bounds = np.full(count, bound)
    window = Window(np.zeros(count), np.ones(count))
    codes, times, values = divided.findings(np.arange(count), Limit(quantity(name), bounds, np.ones(count)), window)
    rows = np.flatnonzero(codes[:, 0] == BROKEN)
    parts = Intervals(rows, 0.0 * ends[rows], ends[rows], np.full((rows.size, 2), bound), times[rows, 0])
    broken = [(name, x) for x in intervals(segments, name, parts, way)]
    return _Found((name,), (codes, times + segments.starts[:, None], values, bounds[:, None]), broken)


def _of_varying(divided: Divided, segments: Segments, name: str, along: Any, factor: float, road: Any) -> _Found:
    """Return the findings on a limit that changes along the way."""
    entry, count = quantity(name), len(segments.starts)
    parts = judged_parts(divided, entry, along, factor)
    worst_part = parts.worst(entry, count)
    known = worst_part >= 0
    defaults = PROVED, segments.starts, np.zeros(count), entry.side * np.inf
    starts = segments.starts[parts.segment]
    found = (parts.codes, parts.times + starts, parts.values, parts.bounds)
    arrays = tuple(np.where(known, x[worst_part], y)[:, None] for x, y in zip(found, defaults, strict=True))
    rows = np.flatnonzero(parts.codes == BROKEN)
    h = segments.durations[parts.segment[rows]]
    start, end = (x[rows] * h for x in parts.window)
    own = Intervals(parts.segment[rows], start, end, parts.curve[rows] / factor, parts.times[rows])
    order = np.argsort(segments.starts[own.segment] + own.start, kind="stable")
    fields: Any = (x[order] for x in own[:5])
    own = Intervals(*fields)
    return _Found((name,), arrays, [(name, x) for x in intervals(segments, name, own, road)])


def _certificate(starts: np.ndarray, names: tuple[str, ...], found: list[_Found]) -> RouteCertificate:
    """Return the certificate of the limits `names` from the findings on them, in any order."""
    own = [name for x in found for name in x.names]
    order = [own.index(name) for name in names]
    codes, times, values, limits = (
        np.concatenate(x, axis=1)[:, order] for x in zip(*(x.arrays for x in found), strict=True)
    )
    codes = codes.astype(np.int32)
    side, column = np.array([quantity(name).side for name in names]), np.arange(len(names))
    varies = (limits != limits[:1]).any(axis=0)
    size = np.where(varies, excess(side, values, limits), side * values)
    candidates = np.where(codes == worst(codes)[None], np.maximum(size, -np.finfo(float).max), -np.inf)
    row = np.argmax(np.where(np.isnan(candidates), np.inf, candidates), axis=0)
    whole = Certificate(names, worst(codes), *(x[row, column] for x in (times, values, limits)))
    broken = [(names.index(name), x) for f in found for name, x in f.broken]
    broken.sort(key=lambda x: x[0])
    parts = Certificate(names, codes, times, values, limits)
    return RouteCertificate(whole, parts, starts, [x for _, x in broken], [k for k, _ in broken])
