"""The constraint that a ball of the body stays clear of an obstacle, for the search for a route."""

from __future__ import annotations

from typing import Any, NamedTuple

from qtraj.algebra.jets import sqrt
from qtraj.design.obstacles.obstacle import AbstractObstacle


class Clear(NamedTuple):
    """A ball with a `radius` [m] and an `offset` in the axes of the upright frame, and an obstacle at rest."""

    name: str
    obstacle: AbstractObstacle
    offset: tuple[float, float, float]
    radius: float

    def value(self, position: Any, velocity: Any) -> Any:
        """Return a smooth function of position and velocity that is at most 1 if the ball is clear.

        The components are arrays or jets; the length of the velocity does not matter.
        """
        return self.obstacle.occupancy(self.centre(position, velocity), self.radius)

    def centre(self, position: Any, velocity: Any) -> Any:
        """Return the components of the centre of the ball."""
        forward, left, up = self.offset
        if not (forward or left or up):
            return position
        x, y, z = velocity
        level = x * x + y * y
        square = level + z * z
        speed = sqrt(square)
        found = [p + (forward * v) / speed for p, v in zip(position, velocity, strict=True)]
        if left or up:
            flat = sqrt(level)
            aside = -y / flat, x / flat
            both = speed * flat
            above = -1.0 * (z * x) / both, -1.0 * (z * y) / both, level / both
            found = [
                found[0] + left * aside[0] + up * above[0],
                found[1] + left * aside[1] + up * above[1],
                found[2] + up * above[2],
            ]
        return found
