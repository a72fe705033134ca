"""Segments of a route that start or end at a stop, where the denominators of most quantities are zero.

If the velocity r' of a segment has a zero of order m at its start and of order k at its end, then r' = u^m·(1 − u)^k·q,
where u is the fraction of the duration. The vector q is parallel to r' and does not vanish at the ends. So the upright
and the natural frame rotate as on a path with velocity q, and the lateral and longitudinal acceleration are the
components of r'' relative to the direction of q.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.polynomial import horner
from qtraj.algebra.sparse import is_one, mul
from qtraj.design.proof.sources import Derivatives, Instants, Source, power_of_two
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.stops import Segments

ZERO = 64 * float(np.finfo(float).eps)
"""The velocity at an end of a segment counts as zero if its product with the duration is at most this fraction of the
size of the segment; for the acceleration, the product with the squared duration is compared."""

Vector = list[ExactPolynomial]

Directed = tuple[Vector, Any]
"""The vector q and the pace r'/q, which may be the integer 1."""

Positions = tuple[Callable[[], list[BoundedPolynomial]], Callable[[int], Vector]]


class DirectedSource(Source):
    """Segments whose velocity is r' = pace·q, with polynomials q and pace; q does not vanish at stops.

    The first derivative is q. The higher derivatives are those of q or, if `keep_acceleration`, those of the velocity.
    `floats` are q and the pace of all segments, and `exact` returns those of segment k. `positions` are functions that
    return the positions of all segments in floats, and the position of segment k; None means that it is not known.
    """

    def __init__(
        self,
        floats: tuple[list[BoundedPolynomial], Any],
        exact: Callable[[int], Directed],
        duration: np.ndarray,
        keep_acceleration: bool = False,
        positions: Positions | None = None,
    ):
        self.duration, self._exact, self._keep = duration, exact, keep_acceleration
        self._positions, self._positioned = positions, False
        q, self._pace = floats
        self.length = power_of_two(np.max([np.abs(p.c).max(axis=0) for p in q], axis=0))
        self._direction = [self._scaled(p) for p in q]
        self._floats: dict[int, Derivatives] = {}

    def provable(self, upright: bool) -> Bool[np.ndarray, " n"]:
        """Return all segments."""
        return np.ones(self.count, bool)

    def proves(self, entry: PathQuantity) -> bool:
        """Return whether a quantity contains no numbers with a unit, and the position is known if it contains that."""
        in_si = entry.own is not None and entry.own.in_si
        return not in_si and (self._positions is not None or not entry.position)

    def positioned(self) -> DirectedSource:
        """Return the same source with the position, if it is known."""
        self._positioned = self._positions is not None
        return self

    def exact(self, k: int, order: int) -> Derivatives:
        """Return the derivatives of segment k as exact polynomials."""
        q, pace = self._exact(k)
        position = tuple(self._positions[1](k)) if self._positions and self._positioned else None
        return self._derivatives(position, q, pace, order)

    def bounded(self, order: int) -> Derivatives:
        """Return the same in bounded floats, for all segments."""
        if order not in self._floats:
            position = None
            if self._positions and self._positioned:
                position = tuple(self._scaled(p) for p in self._positions[0]())
            self._floats[order] = self._derivatives(position, self._direction, self._pace, order)
        return self._floats[order]

    def at(self, u: Instants, order: int) -> Derivatives:
        """Return the derivatives at the fractions `u` of the durations, in floats."""
        found, zero = self.bounded(order), np.zeros_like(u)
        rows = [None if row is None else tuple(horner([*p.c], u) + zero for p in row) for row in found.rows]
        return Derivatives(rows, 1 if is_one(found.pace) else horner([*found.pace.c], u))

    def _derivatives(self, position: Any, q: list[Any], pace: Any, order: int) -> Derivatives:
        vector = [mul(pace, p) for p in q] if self._keep else q
        rows: list[Any] = [position, tuple(q)]
        for _ in range(order - 1):
            vector = [p.derivative() for p in vector]
            rows.append(tuple(vector))
        return Derivatives(rows, pace)

    def _scaled(self, p: BoundedPolynomial) -> BoundedPolynomial:
        return BoundedPolynomial(p.c / self.length, p.m / self.length, p.k)


def standing_source(segments: Segments, rows: np.ndarray, keep_acceleration: bool) -> DirectedSource:
    """Return segments with a stop at one end or at both ends."""
    given = [_divided(_velocity(segments, int(i))) for i in rows]
    q = [BoundedPolynomial(_stacked([own[axis] for own, _ in given]), k=1) for axis in range(3)]
    pace = BoundedPolynomial(_stacked([pace for _, pace in given]), k=1)
    return DirectedSource((q, pace), given.__getitem__, segments.durations[rows], keep_acceleration)


def direction_of(segments: Segments, i: int) -> Vector:
    """Return the vector q of the module for a segment that is a polynomial in the time."""
    return _divided(_velocity(segments, i))[0]


def standing(segments: Segments) -> Bool[np.ndarray, "segments 2"]:
    """Return whether each moving segment starts at a stop, and whether it ends at one."""
    c, h = segments.coefficients, segments.durations
    moving = c[:, 1:].any(axis=(1, 2))
    k = np.arange(1, c.shape[1])[:, None]
    scaled = c[:, 1:] * h[:, None, None] ** k
    sizes = np.abs(scaled).sum(axis=(1, 2))
    start = np.linalg.norm(scaled[:, 0], axis=-1) <= ZERO * sizes
    end = np.linalg.norm((k * scaled).sum(axis=1), axis=-1) <= 1e3 * ZERO * sizes
    for i in np.flatnonzero(end & moving):  # the sum in floats only finds candidates
        end[i] = _starts_at_rest([p.reflected() for p in _velocity(segments, int(i))])
    return np.stack([start & moving, end & moving], axis=1)


def _velocity(segments: Segments, i: int) -> Vector:
    """Return the derivative of the position of a segment with respect to u."""
    c, h = segments.coefficients[i], float(segments.durations[i])
    return [ExactPolynomial.from_floats(c[:, axis]).substituted(h).derivative() for axis in range(3)]


def _divided(velocity: Vector) -> tuple[Vector, ExactPolynomial]:
    """Return q and r'/q of the module; the velocity and a tiny acceleration at a stop are set to zero."""
    u, q, pace = ExactPolynomial([0, 1]), velocity, ExactPolynomial([1])
    for factor in (u, 1 - u):
        if _starts_at_rest(velocity):
            order = _order(velocity)
            q = [p.divided_by_power(order) for p in q]
            for _ in range(order):
                pace = pace * factor
        velocity, q = ([p.reflected() for p in x] for x in (velocity, q))
    return q, pace


def _order(velocity: Vector) -> int:
    """Return the order of the zero of the velocity at u = 0."""
    floats = _stacked(velocity)
    slow = np.abs(floats[1:2]).max(initial=0.0) / 2 <= ZERO * _size(floats)
    moving = np.flatnonzero(floats[2 if slow else 1 :].any(axis=1))
    return int(moving[0]) + (2 if slow else 1) if moving.size else 1


def _starts_at_rest(velocity: Vector) -> bool:
    floats = _stacked(velocity)
    return bool(np.linalg.norm(floats[0]) <= ZERO * _size(floats))


def _size(velocity: Float[np.ndarray, "terms 3"]) -> float:
    """Return the sum of the magnitudes of all terms of the displacement at the end of a segment."""
    return float(np.sum(np.abs(velocity) / np.arange(1, len(velocity) + 1)[:, None]))


def _stacked(polynomials: list[ExactPolynomial]) -> Float[np.ndarray, "terms n"]:
    """Return the coefficients of polynomials in floats, as columns of equal length."""
    columns = [p.floats() for p in polynomials]
    result = np.zeros((max(map(len, columns)), len(columns)))
    for k, column in enumerate(columns):
        result[: len(column), k] = column
    return result
