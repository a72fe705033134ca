"""The segments of a route as pieces."""

from __future__ import annotations

from typing import Any

import numpy as np

from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.obstacles.piece import Piece
from qtraj.design.obstacles.place import Vector
from qtraj.design.proof.composed import directed, positions_of, times_along
from qtraj.design.proof.standing import direction_of
from qtraj.path.driving import Driving, segments_of
from qtraj.path.route import Route
from qtraj.path.stops import Segments

SAME = 1e-9
"""Directions before and after a standstill that differ by less than this angle [rad] count as equal."""


def route_pieces(route: Route, in_time: bool, turns: bool) -> list[Piece]:
    """Return a piece for each segment.

    With `in_time`, the variable is the fraction of the duration of the segment; otherwise, it may be that of its curve.
    With `turns`, the direction matters.
    """
    segments = segments_of(route)
    composed: Any = segments.composed
    moving = np.asarray(segments.coefficients[:, 1:].any(axis=(1, 2)))
    signs = _signs(route, segments) if turns else np.ones(len(moving), int)
    found = []
    for i in range(len(moving)):
        start, h = float(segments.starts[i]), float(segments.durations[i])
        time, evenly = ExactPolynomial.from_floats([start, h]), bool(composed[i]) and not in_time
        report = lambda u, start=start, h=h: start + h * u  # noqa: E731
        if evenly:
            report = lambda u, i=i: _times_on_curve(segments, i, u)  # noqa: E731
        direction = None
        if turns and moving[i]:
            direction = directed(segments, i, evenly)[0] if composed[i] else direction_of(segments, i)
        position = positions_of(segments, i)() if not evenly else _on_curve(segments, i)
        found.append(Piece(position, direction, time, report, sign=int(signs[i])))
    return _with_directions_at_rest(found, moving) if turns else found


def _on_curve(segments: Segments, i: int) -> Vector:
    """Return the position of a curve with a progress as a function of the fraction of the curve."""
    evenly = segments.part([i])
    whole = positions_of(evenly._replace(progress=None, durations=np.ones(1)), 0)()
    start, end = _range(segments, i)
    return [p.composed(start + (end - start) * ExactPolynomial([0, 1])) for p in whole]


def _range(segments: Segments, i: int) -> tuple[ExactPolynomial, ExactPolynomial]:
    """Return the progress at the start and at the end of a segment, exactly."""
    own = ExactPolynomial.from_floats(segments.known_progress()[i])
    at_end = own.substituted(float(segments.durations[i]))
    return ExactPolynomial([own.numbers[0]], own.exponent), ExactPolynomial([sum(at_end.numbers)], at_end.exponent)


def _times_on_curve(segments: Segments, i: int, u: np.ndarray) -> np.ndarray:
    return segments.starts[i] + times_along(segments, np.array([i]), np.atleast_1d(u)[None])[0]


def _signs(route: Route, segments: Segments) -> np.ndarray:
    """Return 1 for segments with forward motion, −1 for reverse, and 0 where a segment contains both."""
    frame = Driving.along(route)
    starts, signs = np.asarray(frame.starts, float), np.asarray(frame.signs)
    known = np.isfinite(starts) & (signs != 0)
    if not known.any() or (signs[known] > 0).all():
        return np.ones(len(segments.starts), int)
    ends = np.append(starts[1:], np.inf)
    found = []
    for start, h in zip(segments.starts, segments.durations, strict=True):
        margin = 1e-6 * h
        own = known & (starts < start + h - margin) & (ends > start + margin)
        if not own.any():  # within a stop
            own = known & (starts <= start)
            own &= starts == starts[own].max() if own.any() else own
        kinds = np.unique(signs[own])
        found.append(int(kinds[0]) if len(kinds) == 1 else 0)
    return np.array(found)


def _with_directions_at_rest(pieces: list[Piece], moving: np.ndarray) -> list[Piece]:
    """Return the pieces; at a standstill between equal directions, the body keeps its direction."""
    found = list(pieces)
    for i in np.flatnonzero(~moving):
        before = next((k for k in range(i - 1, -1, -1) if moving[k]), None)
        after = next((k for k in range(i + 1, len(moving)) if moving[k]), None)
        ends = [(k, u) for k, u in ((before, 1), (after, 0)) if k is not None]
        axes = [_unit(pieces[k], u) for k, u in ends]
        if axes and np.linalg.norm(axes[0] - axes[-1]) < SAME:
            k, u = ends[0]
            at = [p.restricted(u, u) for p in pieces[k].direction or ()]
            found[i] = found[i]._replace(direction=at, sign=pieces[k].sign)
    return found


def _unit(piece: Piece, u: int) -> np.ndarray:
    values = np.array([sum(p.floats()) if u else p.floats()[0] for p in piece.direction or ()])
    return piece.sign * values / np.linalg.norm(values)
