"""Define ellipsoids, which may move."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import subdivision
from qtraj.algebra.combined_claims import AnyClaim, any_of
from qtraj.algebra.surd import Claim
from qtraj.design.obstacles.obstacle import AbstractObstacle, exact_point, moving_point, point_at, shown_point
from qtraj.design.obstacles.place import Place, number, quadratic
from qtraj.foundation.arrays import as_float, concrete, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import namespace, stop_gradient, xp
from qtraj.foundation.types import ArrayInput, Mat3

STEPS = 16
"""Newton steps for the distance; the last one is differentiable."""

SMALLEST, THINNEST = 1e-100, 1e6
"""The smallest semi-axis [m], and the largest ratio of two semi-axes."""

INSIDE = 1 - 2.0**-40
"""A point of the surface is moved inwards by this factor, so that rounding errors cannot put it outside."""


@storable
class Ellipsoid(AbstractObstacle):
    """An ellipsoid that the body must not enter: the points r with (r − c)ᵀ P⁻¹ (r − c) ≤ 1.

    Args:
        centre: c, (3,) [m] in world coordinates; or (terms, 3), ascending coefficients of a polynomial of the time [s]
            since the start of the path, for an ellipsoid that moves.
        shape: P, (3, 3) [m²], symmetric and positive definite; or the three semi-axes (3,) [m] along the world axes.

    Raises:
        ValueError: For wrong shapes, a matrix that is not symmetric and positive definite, semi-axes that are not
            positive, and numbers that are not finite.

    Example:
        >>> Ellipsoid([0.0, 0.0, 0.0], [2.0, 1.0, 1.0]).distance(np.array([5.0, 0.0, 0.0]), 0.0)
        3.0
    """

    centre: Float[Array, "terms 3"]
    shape: Mat3

    def __init__(self, centre: ArrayInput, shape: ArrayInput):
        self.centre = moving_point(centre, "the centre of an ellipsoid")
        self.shape = _matrix(shape)

    def __repr__(self) -> str:
        known = concrete(self.shape)
        axes = "" if known is None else f", semi-axes {_extent(np.sqrt(np.linalg.eigvalsh(known)))} m"
        return f"Ellipsoid({shown_point(self.centre)} m{axes})"

    @property
    def track(self) -> Float[Array, "terms 3"]:
        """The coefficients of the centre."""
        return self.centre

    def at_rest(self) -> Ellipsoid:
        """Return the obstacle as seen from its centre if it moves."""
        return Ellipsoid(0.0 * self.centre[0], self.shape) if self.moves else self

    @property
    def approximate(self) -> bool:
        """Whether `outside` is stricter than necessary on long parts of a path: here, for bodies with a radius."""
        return True

    def distance(self, points: Float[Any, "*n 3"], times: Float[Any, "*n"]) -> Float[Any, "*n"]:
        """Return the distances [m] of points (..., 3) at the times (...) [s], negative inside.

        Inside, the result is (√((r − c)ᵀ P⁻¹ (r − c)) − 1) times the smallest semi-axis, whose magnitude is at most the
        distance from the surface.
        """
        away = points - point_at(self.centre, times)
        linalg: Any = namespace(away, self.shape).linalg
        values, axes = linalg.eigh(stop_gradient(self.shape))
        matrix = xp.broadcast_to(axes.T, (*away.shape[:-1], 3, 3))
        own = (stop_gradient(away)[..., None, :] * matrix).sum(axis=-1)
        s, smallest = 0.0 * own[..., 0], values[0]
        values = xp.broadcast_to(values, own.shape)
        for _ in range(STEPS):
            s = _step(s, values * own * own, values)
        s = xp.maximum(s, 0.0)
        # A last step with the matrix itself gives the derivatives.
        first = _solved(self.shape, s, away)
        second = _solved(self.shape, s, first)
        level = (first * _times(self.shape, first)).sum(axis=-1)
        slope = -2 * (first * _times(self.shape, second)).sum(axis=-1)
        outside = level > 0
        s = s - xp.where(outside, (level - 1) / xp.where(outside, slope, 1.0), 0.0)
        normal = _solved(self.shape, s, away)
        square = (away * _solved(self.shape, 0.0 * s, away)).sum(axis=-1)
        free = square > 1
        length = xp.sqrt(xp.where(free, (normal * normal).sum(axis=-1), 1.0))
        root = xp.sqrt(xp.where(square > 0, square, 1.0))
        depth = (xp.where(square > 0, root, 0.0) - 1) * xp.sqrt(smallest)
        return xp.where(free, s * length, depth)

    def at_least(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Return the distances [m] from planes that touch the ellipsoid, almost where it is nearest."""
        away, P = points - np.asarray(self.centre, float)[0], np.asarray(self.shape, float)
        values, axes = np.linalg.eigh(P)
        own = away @ axes
        s = np.zeros(own.shape[:-1])
        for _ in range(STEPS):
            s = np.asarray(_step(s, values * own * own, values))
        normal = own / (values + s[..., None])
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = normal / np.where(length > 0, length, 1.0)
        return (normal * own).sum(axis=-1) - np.sqrt((normal * normal * values).sum(axis=-1))

    def occupancy(self, centre: Any, reach: float) -> Any:
        """Return 2 − xᵀQ⁻¹x, where the ellipsoid with the matrix Q contains all points within the reach."""
        P = np.asarray(self.shape, float)
        beta = float(np.sqrt(np.trace(P) / 3)) / reach if reach > 0 else np.inf
        inverse = np.linalg.inv(
            (1 + 1 / beta) * P + (reach * reach + (reach * beta if reach > 0 else 0.0) * reach) * np.eye(3)
        )
        x = [p - c for p, c in zip(centre, np.asarray(self.centre, float)[0].tolist(), strict=True)]
        products = [(inverse[i, j] * (2.0 if i < j else 1.0), i, j) for i in range(3) for j in range(i, 3)]
        return 2.0 - sum(weight * (x[i] * x[j]) for weight, i, j in products)

    def outside(self, place: Place, reach: Fraction) -> AnyClaim:
        """Return the claim that a ball does not enter; see `AbstractObstacle`.

        For each β > 0 the ellipsoid with the matrix (1 + 1/β)P + (1 + β)reach² contains all points whose distance is at
        most the reach, and together these ellipsoids contain no others. A centre outside one of them is far enough.
        """
        P = _fractions(self.shape)
        x = place.weighted(place.relative(exact_point(self.centre, place)))
        if reach <= 0:
            smallest = Fraction(float(np.sqrt(np.linalg.eigvalsh(np.asarray(self.shape, float))[0])))
            kept = 1 if not reach else max(1 - _dyadic(-2 * reach / smallest), 0)
            return _outside(P, Fraction(1), Fraction(kept * kept), x, place)
        claims = []
        for beta in self._ratios(place, float(reach)):
            square = (beta + beta * beta) * reach * reach
            Q = [[(1 + beta) * p + (square if i == j else 0) for j, p in enumerate(row)] for i, row in enumerate(P)]
            claims.append(_outside(Q, beta, Fraction(1), x, place))
        return any_of(claims)

    def enters(self, place: Place, reach: Fraction) -> bool:
        """Return whether a ball with a constant `place` is proved to contain a point of the ellipsoid."""
        if reach <= 0:
            return subdivision.decide(self.outside(place, reach)).refuted
        P = _fractions(self.shape)
        adjugate, det = _adjugate(P)
        for away in self._from_centre(place):
            own = [Fraction(x) for x in (INSIDE * self._nearest(away)).tolist()]
            inside = sum(adjugate[i][j] * own[i] * own[j] for i in range(3) for j in range(3)) <= det
            point = [c + number(p) for c, p in zip(exact_point(self.centre, place), own, strict=True)]
            claim = Claim(place.beyond(place.relative(point), number(reach * reach)))
            if inside and subdivision.decide(claim).refuted:
                return True
        return False

    def _from_centre(self, place: Place) -> np.ndarray:
        """Return the centres of the ball in floats relative to the centre of the ellipsoid."""
        return place.near - np.asarray(point_at(np.asarray(self.centre, float), place.near_times))

    def _ratios(self, place: Place, reach: float) -> list[Fraction]:
        """Return the ratios β that are best where the ball is near."""
        P = np.asarray(self.shape, float)
        found = []
        for away in self._from_centre(place):
            normal = np.linalg.solve(P, self._nearest(away))
            found.append(np.sqrt(normal @ P @ normal / (normal @ normal)) / reach)
        kept = {float(np.float32(x)) for x in found if np.isfinite(x) and x > 0}
        return [Fraction(x) for x in kept or {1.0}]

    def _nearest(self, away: np.ndarray) -> np.ndarray:
        """Return the point of the ellipsoid nearest to a point, both relative to its centre; points inside stay."""
        P = np.asarray(self.shape, float)
        if away @ np.linalg.solve(P, away) <= 1:
            return away
        values, axes = np.linalg.eigh(P)
        own, s = axes.T @ away, np.zeros(())
        for _ in range(STEPS):
            s = np.asarray(_step(s, values * own * own, values))
        return axes @ (values * own / (values + s))


def _step(s: Any, squares: Any, values: Any) -> Any:
    """Return a Newton step for Σ squares/(values + s)² = 1, as 1/√Σ = 1, which is almost linear in s."""
    below = values + s[..., None]
    level = (squares / below**2).sum(axis=-1)
    slope = (squares / below**3).sum(axis=-1)
    fine = slope > 0
    return xp.maximum(s + xp.where(fine, level * (xp.sqrt(level) - 1) / xp.where(fine, slope, 1.0), 0.0), 0.0)


def _solved(P: Any, s: Any, x: Any) -> Any:
    """Return (P + s)⁻¹x."""
    shape = (*x.shape, 3)
    matrix = xp.broadcast_to(P, shape) + s[..., None, None] * xp.broadcast_to(np.eye(3, dtype=P.dtype), shape)
    return namespace(matrix, x).linalg.solve(matrix, x[..., None])[..., 0]


def _times(P: Any, x: Any) -> Any:
    return (xp.broadcast_to(P, (*x.shape, 3)) * x[..., None, :]).sum(axis=-1)


def _outside(Q: Any, beta: Fraction, scale: Fraction, x: Sequence[Any], place: Place) -> AnyClaim:
    """Return the claim β xᵀ Q⁻¹ x ≥ scale·W² about the weighted centre x."""
    adjugate, det = _adjugate(Q)
    matrix = [[number(beta * p) for p in row] for row in adjugate]
    return Claim(quadratic(matrix, x) - number(det * scale) * place.weight_sq)


def _fractions(P: Any) -> list[list[Fraction]]:
    return [[Fraction(x) for x in row] for row in np.asarray(P, float).tolist()]


def _adjugate(Q: Sequence[Sequence[Fraction]]) -> tuple[list[list[Fraction]], Fraction]:
    """Return the adjugate and the determinant of a symmetric matrix."""
    found = [
        [
            Q[(i + 1) % 3][(j + 1) % 3] * Q[(i + 2) % 3][(j + 2) % 3]
            - Q[(i + 1) % 3][(j + 2) % 3] * Q[(i + 2) % 3][(j + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    return found, sum((Q[0][j] * found[0][j] for j in range(3)), Fraction(0))


def _dyadic(x: Fraction) -> Fraction:
    """Return a dyadic number that is not smaller than a positive one, and at most larger by 2^-60."""
    return Fraction(-((-x.numerator << 60) // x.denominator), 1 << 60)


def _matrix(given: ArrayInput) -> Any:
    try:
        found = as_float(given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the shape of an ellipsoid must be numbers, but {given!r} was given") from error
    if found.shape not in ((3,), (3, 3)):
        raise ValueError(
            "the shape of an ellipsoid must be a matrix (3, 3) [m²] or three semi-axes (3,) [m], but its shape is "
            f"{found.shape}"
        )
    require_finite(found, "the shape of an ellipsoid")
    known = concrete(found)
    if found.ndim == 1:
        if known is not None and not (known > 0).all():
            raise ValueError(f"the semi-axes of an ellipsoid must be positive [m], but {known.tolist()} was given")
        if known is not None:
            _require_usual(np.asarray(known, float))
        return (found * found)[:, None] * np.eye(3, dtype=found.dtype)
    if known is not None and not ((known == known.T).all() and _positive(_fractions(known))):
        raise ValueError(
            "the matrix of an ellipsoid must be symmetric and positive definite [m²], but "
            f"{known.tolist()} was given: pass 0.5 * (P + P.T) if only rounding errors make it unsymmetric"
        )
    if known is not None:
        _require_usual(np.sqrt(np.maximum(np.linalg.eigvalsh(np.asarray(known, float)), 0.0)))
    return found


def _require_usual(axes: np.ndarray) -> None:
    """Raise a ValueError for semi-axes [m] with which distances cannot be computed in floats."""
    least, most = float(axes.min()), float(axes.max())
    if not (least >= SMALLEST and most <= 1 / SMALLEST and most <= THINNEST * least):
        raise ValueError(
            f"the semi-axes of an ellipsoid must be from {SMALLEST:g} m to {1 / SMALLEST:g} m, and differ by at most a "
            f"factor of {THINNEST:g}, but they are {_extent(axes)} m: use a Cylinder or a HalfSpace"
        )


def _positive(P: Sequence[Sequence[Fraction]]) -> bool:
    """Return whether a symmetric matrix is positive definite, by its leading minors."""
    minors = P[0][0], P[0][0] * P[1][1] - P[0][1] ** 2, _adjugate(P)[1]
    return all(x > 0 for x in minors)


def _extent(x: np.ndarray) -> str:
    return " × ".join(f"{v:.4g}" for v in x)
