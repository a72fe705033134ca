"""Findings on limits that depend on a road whose bank and friction change along the way.

A path is cut where the road changes. In each piece, the parameters of the road are lines with an error (see
`path.road_on_path`). The forces on a vehicle are linear in the cosine and the sine of the bank, so every upper bound on
the size of a force, on the power or on the friction demand is satisfied for a convex set of cosines and sines: if it is
proved at the corners of a square, it is proved in the whole square. Pieces in which it is not proved are halved. Before
that, the limit is checked at the largest value on the road itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra import bernstein
from qtraj.design.limit_checks import depends_on_road
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.route_segments import RANK
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.road_on_path import CORNERS, RoadOnPath
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.values import invariants_at

HALVINGS, MOST = 12, 2**13
"""Pieces are halved at most `HALVINGS` times, as long as there are at most `MOST` of them."""

PLACES, ZOOMS = 33, 6
"""Number of points in each interval of the search for a largest value, and number of intervals, each in the last."""

ROUNDING = 1e-12
"""Relative violation of a limit that exceeds the rounding errors of a value on the road."""

TIGHTER = 2.0**-47
"""Fraction of a limit that changes which exceeds the rounding errors of its coefficients in a piece."""

Judged = Callable[[Int[np.ndarray, " m"], Limit, Window, RoadParameters, RoadParameters | None], Findings]
"""Returns the findings on a limit in windows of segments, for parameters that are linear between those at both ends."""


class _Pieces(NamedTuple):
    """Parts of intervals of the parameter of a path, each in one section of a road."""

    owner: Int[np.ndarray, " m"]
    low: Float[np.ndarray, " m"]
    high: Float[np.ndarray, " m"]
    section: Int[np.ndarray, " m"]

    def halved(self) -> _Pieces:
        owner, low, high, section = (np.repeat(x, 2) for x in self)
        low[1::2] = high[::2] = 0.5 * (self.low + self.high)
        return _Pieces(owner, low, high, section)

    def part(self, chosen: np.ndarray) -> _Pieces:
        return _Pieces(*(x[chosen] for x in self))


class _Limited(NamedTuple):
    """A limit in intervals of the parameter of a path, from `low` to `high`, each in one `segment`."""

    limit: Limit
    segment: Int[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]

    def at(self, owner: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the limit at parameters in intervals."""
        if self.limit.curve is None:
            return np.broadcast_to(self.limit.bounds, self.low.size)[owner]
        return bernstein.values(self.limit.curve[owner], self._place(owner, u))

    def _place(self, owner: np.ndarray, u: np.ndarray) -> np.ndarray:
        span = (self.high - self.low)[owner]
        return (u - self.low[owner]) / np.where(span > 0, span, 1.0)

    def part(self, pieces: _Pieces) -> Limit:
        """Return the limit in pieces of intervals; one that changes is nowhere less strict."""
        entry, owner = self.limit.entry, pieces.owner
        bounds, factors = (np.broadcast_to(x, self.low.size)[owner] for x in (self.limit.bounds, self.limit.factors))
        if self.limit.curve is None:
            return Limit(entry, bounds, factors)
        whole = self.limit.curve[owner]
        curve = bernstein.restricted(whole, *(self._place(owner, x) for x in pieces[1:3]))
        curve = curve - entry.side * TIGHTER * np.abs(whole).max(axis=1, keepdims=True)
        return Limit(entry, entry.side * np.min(entry.side * curve, axis=1), factors, curve)


class OnRoad:
    """A path in segments of the parameter, from `starts` to `ends`, and a vehicle on a road along it."""

    def __init__(self, on: RoadOnPath, starts: Float[np.ndarray, " n"], ends: Float[np.ndarray, " n"], judged: Judged):
        self.on, self.starts, self.ends, self._judged = on, starts, ends, judged

    def supports(self, entry: PathQuantity) -> bool:
        """Return whether the findings on a quantity are those on this road."""
        return depends_on_road(entry, self.on.road)

    def findings(self, segment: Int[np.ndarray, " m"], limit: Limit, window: Window) -> Findings:
        """Return the findings on a limit in windows of segments."""
        require_convex(limit.entry, self.on)
        first, last = self.starts[segment], self.ends[segment]
        low, high = (np.where(x == 1, last, first + x * (last - first)) for x in window)
        task = _Limited(limit, segment, low, np.minimum(high, last))
        pieces = _Pieces(*self.on.cut(task.low, task.high))
        lines, own = self.on.lines(*pieces[1:]), segment[pieces.owner]
        changes = np.any([x != y for x, y in zip(lines.start.numbers, lines.end.numbers, strict=True)], axis=0)
        rough = changes | (lines.error > 0)
        result = np.zeros(rough.size, int), np.zeros(rough.size), np.zeros(rough.size)
        if len(k := np.flatnonzero(~rough)):
            found = self._judged(
                own[k], task.part(pieces.part(k)), self._window(pieces.part(k), own[k]), _rows(lines.start, k), None
            )
            for array, new in zip(result, found, strict=True):
                array[k] = new[:, 0]
        if len(k := np.flatnonzero(rough)):
            for array, new in zip(result, self._changing(pieces.part(k), task), strict=True):
                array[k] = new
        codes, times, values = result
        bounds = task.at(pieces.owner, self.starts[own] + times)
        return _worst(limit.entry, segment.size, pieces.owner, codes, times, values, bounds)

    def _changing(self, pieces: _Pieces, task: _Limited) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the findings on pieces in which the road changes.

        The largest values are those on the road. Where these satisfy the limit, it is proved with lines, in smaller and
        smaller pieces.
        """
        entry, own = task.limit.entry, task.segment[pieces.owner]
        at, values = self._largest(pieces, task)
        bounds = task.at(pieces.owner, at)
        with np.errstate(invalid="ignore"):
            excess = entry.side * (values - bounds)
        undefined, broken = ~np.isfinite(values), excess > ROUNDING * np.abs(bounds)
        codes = np.where(undefined, UNDEFINED, np.where(broken, BROKEN, PROVED))
        origin = np.flatnonzero(codes == PROVED)
        todo, most = pieces.part(origin), max(MOST, 4 * origin.size)
        for _ in range(HALVINGS + 1):
            if not origin.size or origin.size > most:
                break
            found = self._at_corners(todo, task)
            codes[origin[found == SAMPLED]] = SAMPLED
            left = ~np.isin(found, (PROVED, SAMPLED))
            origin, todo = np.repeat(origin[left], 2), todo.part(left).halved()
        codes[origin] = UNDECIDED
        return codes, at - self.starts[own], np.where(undefined, np.nan, values)

    def _largest(self, pieces: _Pieces, task: _Limited) -> tuple[np.ndarray, np.ndarray]:
        """Return where a quantity exceeds its limit most in pieces, and its values there, to within rounding errors."""
        entry, count, rows = task.limit.entry, pieces.low.size, np.arange(pieces.low.size)
        middle, half = 0.5 * (pieces.low + pieces.high), 0.5 * (pieces.high - pieces.low)
        at, value = middle, np.full(count, np.nan)
        owner, section = (np.repeat(x, PLACES) for x in (pieces.owner, pieces.section))
        for _ in range(ZOOMS):
            u = middle[:, None] + half[:, None] * np.linspace(-1.0, 1.0, PLACES)
            u = np.clip(u, pieces.low[:, None], pieces.high[:, None])
            found = task.limit.factors.flat[0] * _values(self.on, entry, u.ravel(), section)
            with np.errstate(invalid="ignore"):
                excess = entry.side * (found - task.at(owner, u.ravel()))
            best = np.argmax(np.where(np.isnan(excess), np.inf, excess).reshape(count, PLACES), axis=1)
            at, value = u[rows, best], found.reshape(count, PLACES)[rows, best]
            middle, half = at, half * (2.0 / (PLACES - 1))
        return at, value

    def _at_corners(self, pieces: _Pieces, task: _Limited) -> np.ndarray:
        """Return the worst status on each piece, of all corners of the lines."""
        own, lines = task.segment[pieces.owner], self.on.lines(*pieces[1:])
        codes, part, window = np.full(own.size, PROVED), task.part(pieces), self._window(pieces, own)
        for number, corner in enumerate(CORNERS):
            k = np.flatnonzero(RANK[codes] <= RANK[SAMPLED])
            k = k[lines.error[k] > 0] if number else k
            if k.size:
                start, end = (_rows(x, k) for x in lines.corner(*corner))
                limit, windows = _limit_rows(part, k), Window(*(x[k] for x in window))
                found = self._judged(own[k], limit, windows, start, end)[0][:, 0]
                codes[k] = np.where(RANK[found] > RANK[codes[k]], found, codes[k])
        return codes

    def _window(self, pieces: _Pieces, own: np.ndarray) -> Window:
        return Window(*(self._fraction(x, own) for x in pieces[1:3]))

    def _fraction(self, u: np.ndarray, own: np.ndarray) -> np.ndarray:
        span = self.ends[own] - self.starts[own]
        found = (u - self.starts[own]) / np.where(span > 0, span, 1.0)
        return np.where(u == self.starts[own], 0.0, np.where(u == self.ends[own], 1.0, np.clip(found, 0.0, 1.0)))


def require_convex(entry: PathQuantity, on: RoadOnPath) -> None:
    """Raise a ValueError for a lower bound on a quantity without sign on a road that changes gradually."""
    if entry.lower and not entry.bounds_side and on.road.kind == "linear":
        raise ValueError(
            f"a lower bound on {entry.base or entry.name} is not supported on a road that changes linearly: pass a "
            "Road with kind='step', or omit the lower bound"
        )


def _values(on: RoadOnPath, entry: PathQuantity, u: np.ndarray, sections: np.ndarray) -> np.ndarray:
    """Return the values of a quantity at parameters of the path."""
    vehicle = on.at(u, sections)
    path: AbstractHodograph = on.on.path
    order, world = max(entry.order, 1), entry.in_world(vehicle)
    with np.errstate(all="ignore"):
        if path.supports_numpy:
            return np.asarray(entry.value(invariants_at(path, u, order, vehicle, world)))
        return np.asarray(_compiled(path, entry, u, vehicle))


@eqx.filter_jit
def _compiled(path: AbstractHodograph, entry: PathQuantity, u: Any, vehicle: RoadParameters) -> Any:
    order, world = max(entry.order, 1), entry.in_world(vehicle)
    at = lambda u, v: jnp.asarray(entry.value(invariants_at(path, u, order, v, world)))  # noqa: E731
    return jax.vmap(at)(u, vehicle)


def _rows(road: RoadParameters, rows: np.ndarray) -> RoadParameters:
    return road.each(lambda x: np.asarray(x)[rows])


def _limit_rows(limit: Limit, rows: np.ndarray) -> Limit:
    curve = None if limit.curve is None else limit.curve[rows]
    return Limit(limit.entry, limit.bounds[rows], limit.factors[rows], curve)


def _worst(entry: PathQuantity, count: int, owner: Any, codes: Any, times: Any, values: Any, bounds: Any) -> Findings:
    """Return the worst of the findings on the pieces of each interval."""
    with np.errstate(invalid="ignore"):
        excess = entry.side * (values - bounds)
    excess = np.where(np.isinf(bounds), entry.side * values, excess)
    order = np.lexsort([np.where(np.isnan(excess), np.inf, excess), RANK[codes], owner])
    last = np.zeros(count, int)
    last[owner[order]] = order
    return Findings(*(x[last][:, None] for x in (codes, times, values)))
