"""Certifies limits on a route, segment by segment, and locates the intervals of violation."""

from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import BROKEN, Certificate
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.proof.route_segments import findings, worst
from qtraj.path import pieces
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity
from qtraj.path.route import Route
from qtraj.path.stops import Segments
from qtraj.path.vehicle import RoadParameters

INSTANTS = 65
"""Number of instants of a segment with a violated limit between which the ends of the intervals are located."""

HALVINGS = 50
"""Number of bisection steps for the ends of an interval."""


def certify_route(route: Route, limits: Limits) -> RouteCertificate:
    """The certificate of one `route` for `limits`; see `certify`.

    **Raises:** ValueError for a batch of routes or inside a trace.
    """
    if route.duration.ndim or any(isinstance(x, Tracer) for x in jax.tree.leaves((route, limits))):
        raise ValueError(
            "certify accepts one route with concrete values: call it outside jit, grad and vmap, once for each route"
        )
    bounds_by_name = {name: float(np.asarray(x)) for name, x in limits.given().items()}
    count = route.segments
    starts, c = np.asarray(route.starts)[:count], np.asarray(route.coefficients)[:count]
    segments = Segments(starts, c, np.diff(np.asarray(route.times)))
    names, bounds = tuple(bounds_by_name), np.array([*bounds_by_name.values()])
    if not names:
        no_limits, no_findings = np.zeros(0), np.zeros((count, 0))
        whole = Certificate((), *[no_limits] * 4)
        return RouteCertificate(whole, Certificate((), *[no_findings] * 4), starts)
    road = limits.road() if limits.needs_vehicle else None
    results = findings(segments, bounds_by_name, road)
    times = results.times + starts[:, None]
    codes, column = worst(results.codes), np.arange(len(names))
    candidates = np.where(results.codes == codes[None], results.values, -np.inf)
    row = np.argmax(np.where(np.isnan(candidates), np.inf, candidates), axis=0)
    whole = Certificate(names, codes, times[row, column], results.values[row, column], bounds)
    parts = Certificate(names, results.codes, times, results.values, np.broadcast_to(bounds, results.codes.shape))
    broken, broken_limits = [], []
    for k, name in enumerate(names):
        rows = np.flatnonzero(results.codes[:, k] == BROKEN)
        intervals = _intervals(segments, name, bounds[k], road, rows, results.times[rows, k])
        broken += intervals
        broken_limits += [k] * len(intervals)
    return RouteCertificate(whole, parts, starts, broken, broken_limits)


def _intervals(
    segments: Segments, name: str, bound: float, road: RoadParameters | None, rows: np.ndarray, peaks: np.ndarray
) -> list[tuple[float, float]]:
    """The intervals in which the segments `rows` exceed a bound; they exceed it at the local times `peaks`."""
    if not rows.size:
        return []
    c, h = segments.coefficients[rows], segments.durations[rows]
    s = np.sort(np.concatenate([h[:, None] * np.linspace(0.0, 1.0, INSTANTS), peaks[:, None]], axis=1), axis=1)
    above = _exceeds(c, s, name, bound, road) | (s == peaks[:, None])
    row, left = np.nonzero(above[:, 1:] != above[:, :-1])
    low, high, first = s[row, left], s[row, left + 1], above[row, left]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        same = _exceeds(c[row], middle[:, None], name, bound, road)[:, 0] == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    intervals: list[tuple[float, float]] = []
    for i, start in enumerate(segments.starts[rows]):
        inner = start + np.where(first, low, high)[row == i]
        edges = [*([start] if above[i, 0] else []), *inner, *([start + h[i]] if above[i, -1] else [])]
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if intervals and a <= intervals[-1][1]:
                intervals[-1] = (intervals[-1][0], float(b))
            else:
                intervals.append((float(a), float(b)))
    return intervals


def _exceeds(c: np.ndarray, s: np.ndarray, name: str, bound: float, road: RoadParameters | None) -> np.ndarray:
    """Whether a quantity is above its bound at local times (segments, instants)."""
    entry = quantity(name)
    c_at_each = np.broadcast_to(c[:, None], (*s.shape, *c.shape[1:]))
    derivatives = pieces.values(c_at_each, s, max(entry.order, 1))
    components: list[Any] = [(r[..., 0], r[..., 1], r[..., 2]) for r in derivatives]
    return np.asarray(entry.exceeds(Invariants(components, vehicle=road, root=np.sqrt), bound))
