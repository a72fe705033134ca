"""Define balls, which may move."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.surd import Claim
from qtraj.algebra.vector import norm
from qtraj.design.obstacles.obstacle import AbstractObstacle, exact_point, moving_point, point_at, shown_point
from qtraj.design.obstacles.place import Place, number
from qtraj.foundation.arrays import real_scalar, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar


@storable
class Ball(AbstractObstacle):
    """A ball that the body must not enter.

    Args:
        centre: (3,) [m] in world coordinates; or (terms, 3), ascending coefficients of a polynomial of the time [s]
            since the start of the path, for a ball that moves.
        radius: in m.

    Raises:
        ValueError: For a centre of another shape, a radius that is not positive, and numbers that are not finite.

    Example:
        >>> Ball([10.0, 0.0, 0.0], 2.0).distance(np.array([15.0, 0.0, 0.0]), 0.0)
        3.0
    """

    centre: Float[Array, "terms 3"]
    radius: Scalar

    def __init__(self, centre: ArrayInput, radius: ArrayInput):
        self.centre = moving_point(centre, "the centre of a ball")
        self.radius = real_scalar(radius, "the radius of a ball")
        require_positive(self.radius, "the radius of a ball", "m")

    def __repr__(self) -> str:
        return f"Ball({shown_point(self.centre)} m, {self.radius:.6g} m)"

    @property
    def track(self) -> Float[Array, "terms 3"]:
        """The coefficients of the centre."""
        return self.centre

    def at_rest(self) -> Ball:
        """Return the obstacle as seen from its centre if it moves."""
        return Ball(0.0 * self.centre[0], self.radius) if self.moves else self

    def distance(self, points: Float[Any, "*n 3"], times: Float[Any, "*n"]) -> Float[Any, "*n"]:
        """Return the distances [m] of points (..., 3) at the times (...) [s], negative inside."""
        return norm(points - point_at(self.centre, times)) - self.radius

    def occupancy(self, centre: Any, reach: float) -> Any:
        """Return 2 − d²/(radius + reach)², with the distance d from the centre."""
        x, y, z = (p - c for p, c in zip(centre, np.asarray(self.centre, float)[0].tolist(), strict=True))
        return 2.0 - (x * x + y * y + z * z) * (float(self.radius) + reach) ** -2

    def outside(self, place: Place, reach: Fraction) -> AnyClaim:
        """Return the claim that a ball does not enter; see `AbstractObstacle`."""
        least = Fraction(float(self.radius)) + reach
        if least <= 0:  # a point that may enter by more than the radius
            return Claim(number(1))
        return Claim(place.beyond(place.relative(exact_point(self.centre, place)), number(least * least)))
