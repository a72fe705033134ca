"""The constraint that a ball of the body stays clear of an obstacle, for searches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.jets import sqrt
from qtraj.design.obstacles.body import POINT, Body
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.path.clearance_quantity import name_of_obstacle


class Clear(NamedTuple):
    """A ball with a `radius` [m] and an `offset` in the axes of the upright frame, and an obstacle.

    `track` contains the components of the coefficients of the point that moves with an obstacle; `obstacle` then is the
    one that does not move, as seen from this point.
    """

    name: str
    obstacle: AbstractObstacle
    offset: tuple[float, float, float]
    radius: float
    track: tuple[tuple[float, ...], ...] | None = None

    def value(self, position: Any, velocity: Any, time: Any = None) -> Any:
        """Return a smooth function of position, velocity and time [s] that is at most 1 if the ball is clear.

        The arguments are arrays or jets; the length of the velocity does not matter.
        """
        centre = self.centre(position, velocity)
        if self.track is not None:
            centre = [x - _polynomial(c, time) for x, c in zip(centre, self.track, strict=True)]
        return self.obstacle.occupancy(centre, self.radius)

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


def clears(keep_out: Sequence[AbstractObstacle] | None, body: Body | None) -> tuple[Clear, ...]:
    """Return a constraint for each pair of an obstacle and a ball of the body, which have concrete values."""
    body = body or POINT
    balls = list(zip(np.asarray(body.offsets, float).tolist(), np.asarray(body.radii, float).tolist(), strict=True))
    found = []
    for k, x in enumerate(keep_out or ()):
        track = tuple(map(tuple, np.asarray(x.track, float).T.tolist())) if x.moves else None
        at_rest = x.at_rest()
        found += [
            Clear(name_of_obstacle(k), at_rest, (offset[0], offset[1], offset[2]), radius, track)
            for offset, radius in balls
        ]
    return tuple(found)


def _polynomial(coefficients: Sequence[float], time: Any) -> Any:
    found: Any = coefficients[-1]
    for c in coefficients[-2::-1]:
        found = c + time * found
    return found
