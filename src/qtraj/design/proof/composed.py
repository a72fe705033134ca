"""Segments of a route that are curves with a progress (see `qtraj.path.progress`), for proofs in exact integers.

The velocity is q·w', where q is the derivative of the curve at w(t). The curve is regular, so q does not vanish at a
stop. Quantities of the shape, such as the curvature, do not depend on the progress: they are proved on the curve
itself, whose parameter is the fraction of the interval that the progress covers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.standing import DirectedSource, Vector
from qtraj.path import pieces, progress
from qtraj.path.stops import Segments


class Composed:
    """The sources of the proofs on curves with a progress; what several kinds of limits need is computed once."""

    def __init__(self, segments: Segments):
        self._segments, self._in_time = segments, {}

    def source(self, rows: np.ndarray, kind: str) -> DirectedSource:
        """Return the source for one kind of limits: "path", "direction", "component" or "shape".

        The kinds are those of `route_segments`. In the kind "shape", the fraction of the duration is that of the curve.
        """
        given: list[Any] = []
        positions = [positions_of(self._segments, int(i)) for i in rows] if kind == "path" else None
        for i in rows:
            q, pace = directed(self._segments, int(i), True) if kind == "shape" else self._directed(int(i))
            given.append(([pace * p for p in q], 1) if kind in ("path", "shape") else (q, pace))
        return DirectedSource(given, self._segments.durations[rows], kind == "component", positions)

    def _directed(self, i: int) -> tuple[Vector, ExactPolynomial]:
        if i not in self._in_time:
            self._in_time[i] = directed(self._segments, i)
        return self._in_time[i]


def directed(segments: Segments, i: int, evenly: bool = False) -> tuple[Vector, ExactPolynomial]:
    """Return q and w' of a segment with respect to the fraction of its duration, or with `evenly` of its curve."""
    place = _progress(segments, i)
    if evenly:
        start = ExactPolynomial.of(place.floats()[0])
        place = start + (_at_one(place) - start) * ExactPolynomial([0, 1])
    slope = _slope(segments, i)
    powers = place.powers(max(len(p.numbers) for p in slope) - 1)
    return [p.combined(powers) for p in slope], place.derivative()


def positions_of(segments: Segments, i: int) -> Callable[[], Vector]:
    """Return a function that returns the position of a segment as a function of the fraction of its duration."""

    def found() -> Vector:
        c, place = segments.coefficients[i], _progress(segments, i)
        powers = place.powers(len(c) - 1)
        origin = np.zeros(3) if segments.origin is None else segments.origin
        own = [ExactPolynomial.from_floats(c[:, axis]).combined(powers) for axis in range(3)]
        return [p + float(x) for p, x in zip(own, origin, strict=True)]

    return found


def _progress(segments: Segments, i: int) -> ExactPolynomial:
    """Return the progress as a function of the fraction of the duration."""
    return ExactPolynomial.from_floats(segments.known_progress()[i]).substituted(float(segments.durations[i]))


def _slope(segments: Segments, i: int) -> Vector:
    """Return the derivative of a curve with respect to its parameter."""
    c = segments.coefficients[i]
    return [ExactPolynomial.from_floats(c[:, axis]).derivative() for axis in range(3)]


def _at_one(p: ExactPolynomial) -> ExactPolynomial:
    return ExactPolynomial([sum(p.numbers)], p.exponent)


def times_along(segments: Segments, rows: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """Return the times [s] in the segments `rows` (n,) at which the `fraction` (n, k) of the curve is covered."""
    own, h = segments.known_progress()[rows][:, None], segments.durations[rows][:, None]
    start, end = (pieces.values(own[..., None], t, 0)[0][..., 0] for t in (0.0 * h, h))
    found = progress.times_at(own + np.zeros((*fraction.shape, 1)), h, start + fraction * (end - start))
    return np.where(fraction >= 1, h, found)


def fractions_along(segments: Segments, fraction: np.ndarray) -> np.ndarray:
    """Return the fractions of the curves that the segments cover up to the `fraction` (n,) of their durations."""
    own, h = segments.known_progress(), segments.durations
    start, end, at = (pieces.values(own[..., None], t, 0)[0][..., 0] for t in (0.0 * h, h, fraction * h))
    return np.clip((at - start) / np.where(end != start, end - start, 1.0), 0.0, 1.0)
