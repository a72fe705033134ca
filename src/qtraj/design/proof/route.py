"""Limits judged on a whole route, segment by segment."""

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
"""Instants of a broken segment between which the ends of intervals are sought."""

HALVINGS = 50


def certify_route(route: Route, limits: Limits) -> RouteCertificate:
    """What is known of `route` against `limits`; see `certify`.

    **Raises:** ValueError for many routes or inside a trace, whose segments are not known.
    """
    if route.duration.ndim or any(isinstance(x, Tracer) for x in jax.tree.leaves((route, limits))):
        raise ValueError(
            "limits are judged on one route whose numbers are known: call certify outside jit, grad and vmap, once for "
            "each route"
        )
    given = {name: float(np.asarray(x)) for name, x in limits.given().items()}
    count = route.segments
    starts, c = np.asarray(route.starts)[:count], np.asarray(route.coefficients)[:count]
    segments = Segments(starts, c, np.diff(np.asarray(route.times)))
    names, bounds = tuple(given), np.array([*given.values()])
    if not names:
        none, each = np.zeros(0), np.zeros((count, 0))
        return RouteCertificate(
            Certificate((), none, none, none, none), Certificate((), each, each, each, each), starts
        )
    road = limits.road() if limits.needs_vehicle else None
    found = findings(segments, given, road)
    times = found.times + starts[:, None]
    codes, column = worst(found.codes), np.arange(len(names))
    rank = np.where(found.codes == codes[None], found.values, -np.inf)
    place = np.argmax(np.where(np.isnan(rank), np.inf, rank), axis=0)
    whole = Certificate(names, codes, times[place, column], found.values[place, column], bounds)
    parts = Certificate(names, found.codes, times, found.values, np.broadcast_to(bounds, found.codes.shape))
    spans, numbers = [], []
    for k, name in enumerate(names):
        some = np.flatnonzero(found.codes[:, k] == BROKEN)
        own = _intervals(segments, name, bounds[k], road, some, found.times[some, k])
        spans += own
        numbers += [k] * len(own)
    return RouteCertificate(whole, parts, starts, spans, numbers)


def _intervals(
    segments: Segments, name: str, bound: float, road: RoadParameters | None, some: np.ndarray, seen: np.ndarray
) -> list[tuple[float, float]]:
    """The intervals in which `some` segments exceed a bound; it is seen to be exceeded at a local time of each."""
    if not some.size:
        return []
    c, h = segments.coefficients[some], segments.durations[some]
    s = np.sort(np.concatenate([h[:, None] * np.linspace(0.0, 1.0, INSTANTS), seen[:, None]], axis=1), axis=1)
    above = _exceeds(c, s, name, bound, road) | (s == seen[:, None])
    row, left = np.nonzero(above[:, 1:] != above[:, :-1])
    low, high, first = s[row, left], s[row, left + 1], above[row, left]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        same = _exceeds(c[row], middle[:, None], name, bound, road)[:, 0] == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    found: list[tuple[float, float]] = []
    for i, start in enumerate(segments.starts[some]):
        inner = start + np.where(first, low, high)[row == i]
        edges = [*([start] if above[i, 0] else []), *inner, *([start + h[i]] if above[i, -1] else [])]
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if found and a <= found[-1][1]:
                found[-1] = (found[-1][0], float(b))
            else:
                found.append((float(a), float(b)))
    return found


def _exceeds(c: np.ndarray, s: np.ndarray, name: str, bound: float, road: RoadParameters | None) -> np.ndarray:
    """Whether a quantity is above its bound at local times (segments, instants)."""
    entry = quantity(name)
    spread = np.broadcast_to(c[:, None], (*s.shape, *c.shape[1:]))
    rows: list[Any] = [(r[..., 0], r[..., 1], r[..., 2]) for r in pieces.values(spread, s, max(entry.order, 1))]
    return np.asarray(entry.exceeds(Invariants(rows, vehicle=road, root=np.sqrt), bound))
