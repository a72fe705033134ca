"""Findings on limits that depend on a road whose bank and friction change along the way.

A path is cut where the road changes. In each piece, the parameters of the road are lines with an error (see
`path.road_on_path`). The forces on a vehicle are linear in the cosine and the sine of the bank, so every upper bound on
the size of a force, on the power or on the friction demand is satisfied for a convex set of cosines and sines: if it is
proved at the corners of a square, it is proved in the whole square. Pieces in which it is not proved are halved, until
it is proved, or violated at an instant on the road itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.route_segments import RANK
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.road_on_path import CORNERS, RoadOnPath
from qtraj.path.values import invariants_at
from qtraj.path.vehicle import RoadParameters

HALVINGS, MOST = 12, 2**13
"""Pieces are halved at most `HALVINGS` times, as long as there are at most `MOST` of them."""

TIGHTER = 2.0**-50
"""Fraction of a linear limit that exceeds the rounding errors of its values at the ends of a piece."""

Judged = Callable[[Int[np.ndarray, " m"], Limit, Window, RoadParameters, RoadParameters], Findings]
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


class OnRoad:
    """A path in segments of the parameter, from `starts` to `ends`, and a vehicle on a road along it."""

    def __init__(
        self, on: RoadOnPath, starts: Float[np.ndarray, " n"], ends: Float[np.ndarray, " n"], judged: Judged
    ):
        self.on, self.starts, self.ends, self._judged = on, starts, ends, judged

    def findings(self, segment: Int[np.ndarray, " m"], limit: Limit, window: Window) -> Findings:
        """Return the findings on a limit in windows of segments."""
        require_convex(limit.entry, self.on)
        first, last = self.starts[segment], self.ends[segment]
        low, high = (np.where(x == 1, last, first + x * (last - first)) for x in window)
        todo = _Pieces(*self.on.cut(low, np.minimum(high, last)))
        found: list[tuple[np.ndarray, ...]] = []
        for depth in range(HALVINGS + 1):
            *codes_times_values, bounds, rough = self._pieces(todo, segment, limit, (low, high))
            codes, times, values = codes_times_values
            again = rough & ~np.isin(codes, (PROVED, SAMPLED, BROKEN, UNDEFINED))
            if depth == HALVINGS or len(todo.owner) > MOST or not again.any():
                again[:] = False
            found.append(tuple(x[~again] for x in (todo.owner, codes, times, values, bounds)))
            if not again.any():
                break
            todo = todo.part(again).halved()
        return _worst(limit.entry, segment.size, *(np.concatenate(x) for x in zip(*found, strict=True)))

    def _pieces(
        self, pieces: _Pieces, segment: np.ndarray, limit: Limit, ends: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, ...]:
        """Return codes, times, values and bounds on pieces, and where the lines are not close to the road.

        With lines that are not close, BROKEN and UNDEFINED are confirmed on the road itself; all other findings that
        are not proved are UNDECIDED.
        """
        k, entry = pieces.owner, limit.entry
        own, (low, high) = segment[k], (x[k] for x in ends)
        window = Window(*(self._fraction(x, own) for x in (pieces.low, pieces.high)))
        part = _of_pieces(limit, segment.size, k, [(x - low) / np.where(high > low, high - low, 1.0) for x in pieces[1:3]])
        lines = self.on.lines(pieces.low, pieces.high, pieces.section)
        rough = (lines.error > 0) | np.any([x != y for x, y in zip(lines.start, lines.end, strict=True)], axis=0)
        codes, times, values = (x[:, 0] for x in self._judged(own, part, window, *lines.corner(1, 1)))
        if (several := np.flatnonzero(lines.error > 0)).size:
            for corner in CORNERS[1:]:
                chosen = lines.corner(*corner)
                start, end = (RoadParameters(*(np.asarray(x)[several] for x in y)) for y in chosen)
                parts = _rows(part, several), Window(*(x[several] for x in window))
                more = [x[:, 0] for x in self._judged(own[several], *parts, start, end)]
                worse = several[np.flatnonzero(RANK[more[0]] > RANK[codes[several]])]
                at = np.searchsorted(several, worse)
                for array, new in zip((codes, times, values), more, strict=True):
                    array[worse] = new[at]
        bounds = part.at(_place(times + self.starts[own], pieces)) if part.line is not None else part.bounds
        if not rough.any():
            return codes, times, values, bounds, rough
        place = np.clip(times + self.starts[own], pieces.low, pieces.high)
        true = part.factors * _values(self.on, entry, place, pieces.section)
        with np.errstate(invalid="ignore"):
            broken = entry.side * (true - bounds) > 0
        undefined = ~np.isfinite(true)
        confirmed = np.where(undefined, UNDEFINED, np.where(broken, BROKEN, UNDECIDED))
        settled = ~rough | np.isin(codes, (PROVED, SAMPLED))
        values = np.where(rough, np.where(settled & broken, bounds, np.where(undefined, np.nan, true)), values)
        return np.where(settled, codes, confirmed), times, values, bounds, rough

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
    with np.errstate(all="ignore"):
        if path.supports_numpy:
            return np.asarray(entry.value(invariants_at(path, u, max(entry.order, 1), vehicle)))
        each = [RoadParameters(*(x[k] for x in vehicle)) for k in range(u.size)]
        found = [entry.value(invariants_at(path, x, max(entry.order, 1), v)) for x, v in zip(u, each, strict=True)]
        return np.array(found, float)


def _place(u: np.ndarray, pieces: _Pieces) -> np.ndarray:
    span = pieces.high - pieces.low
    return (u - pieces.low) / np.where(span > 0, span, 1.0)


def _of_pieces(limit: Limit, count: int, owner: np.ndarray, places: list[np.ndarray]) -> Limit:
    """Return the limit in pieces of intervals, from the first to the second of the `places` in them."""
    bounds, factors = (np.broadcast_to(x, count)[owner] for x in (limit.bounds, limit.factors))
    if limit.line is None:
        return Limit(limit.entry, bounds, factors)
    first, rise = limit.line[owner, 0], limit.line[owner, 1] - limit.line[owner, 0]
    line = np.stack([first + x * rise for x in places], axis=1)
    line = line - limit.entry.side * TIGHTER * np.abs(limit.line[owner]).max(axis=1, keepdims=True)
    return Limit(limit.entry, limit.entry.side * np.min(limit.entry.side * line, axis=1), factors, line)


def _rows(limit: Limit, rows: np.ndarray) -> Limit:
    line = None if limit.line is None else limit.line[rows]
    return Limit(limit.entry, limit.bounds[rows], limit.factors[rows], line)


def _worst(entry: PathQuantity, count: int, owner: Any, codes: Any, times: Any, values: Any, bounds: Any) -> Findings:
    """Return the worst of the findings on the pieces of each interval."""
    with np.errstate(invalid="ignore"):
        excess = entry.side * (values - bounds)
    excess = np.where(np.isinf(bounds), entry.side * values, excess)
    order = np.lexsort([np.where(np.isnan(excess), np.inf, excess), RANK[codes], owner])
    last = np.zeros(count, int)
    last[owner[order]] = order
    return Findings(*(x[last][:, None] for x in (codes, times, values)))
