"""Segments of a route that are curves with a progress (see `qtraj.path.progress`), for proofs.

The velocity is q·w', where q is the derivative of the curve at w(t). The curve is regular, so q does not vanish at a
stop. Quantities of the shape, such as the curvature, do not depend on the progress: they are proved on the curve
itself, whose parameter is the fraction of the interval that the progress covers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.sources import powers
from qtraj.design.proof.standing import Directed, DirectedSource, Vector
from qtraj.path import pieces, progress
from qtraj.path.stops import Segments


def composed_source(segments: Segments, rows: np.ndarray, kind: str) -> DirectedSource:
    """Return the source for one kind of limits: "path", "direction", "component" or "shape".

    The kinds are those of `route_segments`. In the kind "shape", the fraction of the duration is that of the curve.
    """
    evenly, whole = kind == "shape", kind in ("path", "shape")

    def of_kind(q: list[Any], pace: Any) -> tuple[list[Any], Any]:
        return ([pace * p for p in q], 1) if whole else (q, pace)

    def exact(k: int) -> Directed:
        return of_kind(*directed(segments, int(rows[k]), evenly))

    positions = (lambda: _positions(segments, rows)), (lambda k: positions_of(segments, int(rows[k]))())
    with np.errstate(all="ignore"):  # after an overflow, nothing is decided in floats
        floats = of_kind(*_directed(segments, rows, evenly))
    return DirectedSource(
        floats, exact, segments.durations[rows], kind == "component", positions if kind == "path" else None
    )


def directed(segments: Segments, i: int, evenly: bool = False) -> tuple[Vector, ExactPolynomial]:
    """Return q and w' of a segment with respect to the fraction of its duration, or with `evenly` of its curve."""
    place = _progress(segments, i)
    if evenly:
        start = ExactPolynomial.of(place.floats()[0])
        place = start + (_at_one(place) - start) * ExactPolynomial([0, 1])
    slope = _slope(segments, i)
    each = place.powers(max(len(p.numbers) for p in slope) - 1)
    return [p.combined(each) for p in slope], place.derivative()


def _directed(segments: Segments, rows: np.ndarray, evenly: bool) -> tuple[list[BoundedPolynomial], BoundedPolynomial]:
    """Return the same for many segments, in bounded floats."""
    place = _places(segments, rows)
    if evenly:
        # Without the start, so that nothing cancels.
        covered = BoundedPolynomial(place.c[1:].sum(axis=0)[None], place.m[1:].sum(axis=0)[None], place.k + 3)
        place = BoundedPolynomial(place.c[:1]) + covered * _identity(len(rows))
    q = [p.derivative().composed(place).consolidated() for p in _curves(segments, rows)]
    return q, place.derivative()


def _identity(count: int) -> BoundedPolynomial:
    """Return the polynomial u, `count` times."""
    return BoundedPolynomial(np.repeat([[0.0], [1.0]], count, axis=1))


def _positions(segments: Segments, rows: np.ndarray) -> list[BoundedPolynomial]:
    """Return the positions of many segments as functions of the fractions of their durations, in bounded floats."""
    place = _places(segments, rows)
    origin = np.zeros(3) if segments.origin is None else segments.origin
    shifts = [BoundedPolynomial.constant(np.full(len(rows), float(x))) for x in origin]
    return [p.composed(place) + shift for p, shift in zip(_curves(segments, rows), shifts, strict=True)]


def _curves(segments: Segments, rows: np.ndarray) -> list[BoundedPolynomial]:
    c = segments.coefficients[rows].T  # (3, terms, n)
    return [BoundedPolynomial(np.ascontiguousarray(row)) for row in c]


def _places(segments: Segments, rows: np.ndarray) -> BoundedPolynomial:
    """Return the progress as a function of the fraction of the duration, for many segments."""
    c = segments.known_progress()[rows].T
    return BoundedPolynomial(c * powers(segments.durations[rows], len(c)), k=len(c) + 1)


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
