"""Define half spaces, such as the ground."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.vector import norm
from qtraj.design.obstacles.obstacle import AbstractObstacle, shown_point
from qtraj.design.obstacles.place import Place, number, total
from qtraj.design.obstacles.walls import beyond_wall
from qtraj.foundation.arrays import concrete, real_scalar, real_vector, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ArrayInput, Scalar, Vec3


@storable
class HalfSpace(AbstractObstacle):
    """The half space of the points r with normal·r ≤ offset, which the body must not enter, such as the ground.

    Args:
        normal: (3,), points out of the obstacle, in world components, of any length.
        offset: for a normal of length 1, the distance [m] of the plane from the origin in the direction of the normal.

    Raises:
        ValueError: For a wrong shape, a zero normal, and numbers that are not finite.

    Example:
        >>> HalfSpace([0.0, 0.0, 1.0], 1.5).distance(np.array([0.0, 0.0, 4.0]), 0.0)
        2.5
    """

    normal: Vec3
    offset: Scalar

    def __init__(self, normal: ArrayInput, offset: ArrayInput):
        self.normal = real_vector(normal, "the normal of a half space", 3)
        self.offset = real_scalar(offset, "the offset of a half space")
        require_finite(self.offset, "the offset of a half space")
        known = concrete(self.normal)
        if known is not None and not known.any():
            raise ValueError("the normal of a half space must not be zero")

    def __repr__(self) -> str:
        return f"HalfSpace({shown_point(self.normal[None])}, {self.offset:.6g} m)"

    def distance(self, points: Float[Any, "*n 3"], times: Float[Any, "*n"]) -> Float[Any, "*n"]:
        """Return the distances [m] of points (..., 3), negative inside; the times do not matter."""
        return ((points * xp.broadcast_to(self.normal, points.shape)).sum(axis=-1) - self.offset) / norm(self.normal)

    @property
    def occupied_length(self) -> bool:
        """True."""
        return True

    def occupancy(self, centre: Any, reach: float) -> Any:
        """Return 1 plus how far [m] the ball is beyond the plane."""
        length = float(np.linalg.norm(np.asarray(self.normal, float)))
        a, b, c = (np.asarray(self.normal, float) / length).tolist()
        x, y, z = centre
        return 1.0 + reach + float(self.offset) / length - (a * x + b * y + c * z)

    def outside(self, place: Place, reach: Fraction) -> AnyClaim:
        """Return the claim that a ball does not enter; see `AbstractObstacle`."""
        normal = [number(x) for x in np.asarray(self.normal, float)]
        x = place.weighted(place.position)
        height = total(n * p for n, p in zip(normal, x, strict=True)) - number(float(self.offset)) * place.weight
        return beyond_wall(height, total(n * n for n in normal), reach, place)
