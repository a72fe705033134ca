"""Divide a drive into its course: zones next to stops, the stops, and the parts in between.

Along the course, the parameter w of the curve increases like the time, except that it follows the progress in zones and
is constant at stops.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.fitting.zone_progress import ZoneProgress
from qtraj.design.fitting.zones import Zone

NEAR = 0.2
"""Minimum distance of a knot from a zone, in median knot spacings; closer knots are removed."""


class Piece(NamedTuple):
    """A part of the course from `start` to `end`, which begins at the parameter `first` and covers `advance`.

    `zone` is its progress, or None; `stop` indicates a stop between zones. `sense` is 1, or −1 after an odd number of
    reversals.
    """

    start: float
    end: float
    first: float
    advance: float
    zone: ZoneProgress | None
    stop: bool
    sense: float


class Course(NamedTuple):
    """The pieces of a drive in order, without gaps."""

    pieces: list[Piece]

    def at(self, t: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the parameter w and its derivative at increasing times."""
        w, rate = np.empty_like(t), np.ones_like(t)
        starts = np.array([piece.start for piece in self.pieces])
        owner = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)
        for k, piece in enumerate(self.pieces):
            own = owner == k
            if piece.stop:
                w[own], rate[own] = piece.first, 0.0
            elif piece.zone is None:
                w[own] = piece.first + (t[own] - piece.start)
            else:
                inside, rate[own] = piece.zone.at(t[own])
                w[own] = piece.first + np.clip(inside, 0.0, piece.advance)
        return w, rate


class Joints(NamedTuple):
    """The knots w (m,) of the curve, whether a segment is a stop, and the piece and the sense of each segment."""

    knots: Float[np.ndarray, " m"]
    is_stop: Bool[np.ndarray, " segments"]
    piece: Int[np.ndarray, " segments"]
    sense: Float[np.ndarray, " segments"]


def course(
    duration: float, stops: list[tuple[float, float]], zones: list[Zone], progress: list[ZoneProgress]
) -> Course:
    """Return the course of a drive with these zones; stops without a zone are parts of other pieces."""
    ends = {zone.stop for zone in zones}
    turns = np.array([zone.stop for zone in zones if zone.turns and zone.stop > zone.end])
    parts: list[tuple[float, float, ZoneProgress | None, bool]] = [
        (a, b, None, True) for a, b in stops if b > a and (a in ends or b in ends)
    ]
    parts += [(*zone.interval, own, False) for zone, own in zip(zones, progress, strict=True)]
    pieces, at, w = [], 0.0, 0.0
    for start, end, zone, stop in [*sorted(parts, key=lambda x: x[:2]), (duration, duration, None, True)]:
        if start > at:
            pieces.append(Piece(at, start, w, start - at, None, False, _sense(turns, at)))
            w += start - at
        if end > start:
            advance = 0.0 if stop else zone.advance if zone is not None else end - start
            pieces.append(Piece(start, end, w, advance, zone, stop, _sense(turns, start)))
            w += advance
        at = end
    return Course(pieces)


def _sense(turns: Float[np.ndarray, " n"], at: float) -> float:
    """Return the sense of a piece that begins at the time `at`, for the times of the points of reversal."""
    return (-1.0) ** np.count_nonzero(turns <= at)


def joints(of: Course, knots: Float[np.ndarray, " m"], is_stop: Bool[np.ndarray, " segments"]) -> Joints:
    """Return the knots of the curve: those of the fit in time outside the zones, and the ends of the zones."""
    near = NEAR * float(np.median(np.diff(knots)))
    at_stop = np.append(is_stop, False) | np.append(False, is_stop)
    found, standing, owners = [0.0], [], []
    for k, piece in enumerate(of.pieces):
        if piece.stop:
            continue
        inner = np.zeros(0)
        if piece.zone is None:
            margin = np.where(at_stop, 0.0, near)
            inner = knots[(knots > piece.start + margin) & (knots < piece.end - margin)]
        edges = np.concatenate([[piece.start], inner, [piece.end]])
        middles = np.searchsorted(knots, 0.5 * (edges[1:] + edges[:-1]), side="right") - 1
        standing += (is_stop[middles] & (piece.zone is None)).tolist()
        owners += [k] * (len(edges) - 1)
        found += [*(piece.first + (inner - piece.start)), piece.first + piece.advance]
    sense = np.array([of.pieces[k].sense for k in owners])
    return Joints(np.array(found), np.array(standing, bool), np.array(owners), sense)
