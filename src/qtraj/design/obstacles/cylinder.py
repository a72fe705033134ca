"""Define infinite cylinders, which may move."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.surd import Claim
from qtraj.algebra.vector import cross, norm
from qtraj.design.obstacles.obstacle import AbstractObstacle, exact_point, moving_point, point_at, shown_point
from qtraj.design.obstacles.place import Place, number, quadratic
from qtraj.foundation.arrays import concrete, real_scalar, real_vector, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ArrayInput, Scalar, Vec3


@storable
class Cylinder(AbstractObstacle):
    """An infinite cylinder that the body must not enter, such as a mast.

    Args:
        point: a point on the axis, (3,) [m] in world coordinates; or (terms, 3), ascending coefficients of a polynomial
            of the time [s] since the start of the path, for a cylinder that moves.
        axis: (3,), the direction of the axis in world components, of any length.
        radius: in m.

    Raises:
        ValueError: For wrong shapes, a zero axis, a radius that is not positive, and numbers that are not finite.

    Example:
        >>> Cylinder([10.0, 0.0, 0.0], [0.0, 0.0, 1.0], 2.0).distance(np.array([15.0, 0.0, 7.0]), 0.0)
        3.0
    """

    point: Float[Array, "terms 3"]
    axis: Vec3
    radius: Scalar

    def __init__(self, point: ArrayInput, axis: ArrayInput, radius: ArrayInput):
        self.point = moving_point(point, "the point of a cylinder")
        self.axis = real_vector(axis, "the axis of a cylinder", 3)
        self.radius = real_scalar(radius, "the radius of a cylinder")
        known = concrete(self.axis)
        if known is not None and not known.any():
            raise ValueError("the axis of a cylinder must not be zero")
        require_positive(self.radius, "the radius of a cylinder", "m")

    def __repr__(self) -> str:
        return f"Cylinder({shown_point(self.point)} m, {shown_point(self.axis[None])}, {self.radius:.6g} m)"

    @property
    def track(self) -> Float[Array, "terms 3"]:
        """The coefficients of the point."""
        return self.point

    def at_rest(self) -> Cylinder:
        """Return the obstacle as seen from its point if it moves."""
        return Cylinder(0.0 * self.point[0], self.axis, self.radius) if self.moves else self

    def distance(self, points: Float[Any, "*n 3"], times: Float[Any, "*n"]) -> Float[Any, "*n"]:
        """Return the distances [m] of points (..., 3) at the times (...) [s], negative inside."""
        away = points - point_at(self.point, times)
        return norm(cross(xp.broadcast_to(self.axis, away.shape), away)) / norm(self.axis) - self.radius

    def occupancy(self, centre: Any, reach: float) -> Any:
        """Return 2 − d²/(radius + reach)², with the distance d from the axis."""
        x, y, z = (p - c for p, c in zip(centre, np.asarray(self.point, float)[0].tolist(), strict=True))
        a, b, c = (np.asarray(self.axis, float) / np.linalg.norm(np.asarray(self.axis, float))).tolist()
        along = a * x + b * y + c * z
        return 2.0 - (x * x + y * y + z * z - along * along) * (float(self.radius) + reach) ** -2

    def outside(self, place: Place, reach: Fraction) -> AnyClaim:
        """Return the claim that a ball does not enter; see `AbstractObstacle`.

        With the axis a, the square of the distance from the axis times |a|² is xᵀ(|a|² − a aᵀ)x.
        """
        a = [Fraction(x) for x in np.asarray(self.axis, float).tolist()]
        length_sq = sum(x * x for x in a)
        matrix = [[number((length_sq if i == j else 0) - a[i] * a[j]) for j in range(3)] for i in range(3)]
        least = Fraction(float(self.radius)) + reach
        if least <= 0:  # a point that may enter by more than the radius
            return Claim(number(1))
        x = place.weighted(place.relative(exact_point(self.point, place)))
        return Claim(quadratic(matrix, x) - number(length_sq * least * least) * place.weight_sq)
