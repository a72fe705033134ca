"""Define upright walls around a convex polygon, such as a building."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.combined_claims import AnyClaim, all_of, any_of
from qtraj.algebra.jets import sqrt
from qtraj.algebra.surd import Claim
from qtraj.algebra.vector import norm
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.obstacles.place import Place, number
from qtraj.design.obstacles.walls import beyond_wall
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ArrayInput

ROUNDING = 2e-3
"""The part of the length of the shortest wall with which searches round the corners for a point."""


@storable
class ConvexPolygon(AbstractObstacle):
    """Upright walls of any height around a convex polygon of the horizontal plane, such as a building.

    Args:
        vertices: (m, 2) [m], at least three corners in order, in world coordinates; either sense is accepted.

    Raises:
        ValueError: For another shape, numbers that are not finite, and corners that are not those of a convex polygon.

    Example:
        >>> house = ConvexPolygon([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
        >>> house.distance(np.array([7.0, 7.0, 1.0]), 0.0)
        5.0
    """

    vertices: Float[Array, "m 2"]

    def __init__(self, vertices: ArrayInput):
        try:
            found = as_float(vertices)
        except (TypeError, ValueError) as error:
            raise ValueError("the vertices of a polygon must be numbers [m] of shape (m, 2)") from error
        if found.ndim != 2 or found.shape[1] != 2 or found.shape[0] < 3:
            raise ValueError(
                f"the vertices of a polygon must have shape (m, 2) with m ≥ 3, but their shape is {found.shape}"
            )
        known = concrete(found)
        self.vertices = found if known is None else found[:: _sense(np.asarray(known, float))]

    def __repr__(self) -> str:
        return f"ConvexPolygon({self.vertices.shape[0]} vertices)"

    def distance(self, points: Float[Any, "*n 3"], times: Float[Any, "*n"]) -> Float[Any, "*n"]:
        """Return the distances [m] of points (..., 3), negative inside; height and times do not matter."""
        shape = (*points.shape[:-1], *self.vertices.shape)
        start, edge = self.vertices, xp.roll(self.vertices, -1, axis=0) - self.vertices
        away, length = points[..., None, :2] - xp.broadcast_to(start, shape), xp.broadcast_to(norm(edge), shape[:-1])
        edge = xp.broadcast_to(edge, shape)
        height = (away[..., 0] * edge[..., 1] - away[..., 1] * edge[..., 0]) / length
        after = xp.roll(start, -1, axis=0)
        height = height * xp.sign(xp.sum(start[:, 0] * after[:, 1] - start[:, 1] * after[:, 0]))  # in either sense
        along = xp.clip((away * edge).sum(axis=-1) / (length * length), 0.0, 1.0)
        nearest = xp.min(norm(away - along[..., None] * edge), axis=-1)
        inside = xp.max(height, axis=-1)
        return xp.where(inside <= 0, inside, nearest)

    @property
    def occupied_length(self) -> bool:
        """True."""
        return True

    @property
    def rounding(self) -> float:
        """A small part of the length of the shortest wall."""
        vertices = np.asarray(self.vertices, float)
        return ROUNDING * float(np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1).min())

    def occupancy(self, centre: Any, reach: float) -> Any:
        """Return 1 plus how far [m] the ball reaches beyond the nearest wall or corner."""
        x, y, _ = centre
        a, b = (xp.asarray(getattr(p, "value", p)) for p in (x, y))
        vertices = np.asarray(self.vertices, float)
        edge = np.roll(vertices, -1, axis=0) - vertices
        length = np.linalg.norm(edge, axis=1)
        ahead, normal = edge / length[:, None], np.stack([edge[:, 1], -edge[:, 0]], axis=1) / length[:, None]
        shape = (*a.shape, *vertices.shape)
        away = xp.broadcast_to(xp.stack([a, b], axis=-1)[..., None, :], shape) - np.broadcast_to(vertices, shape)
        height, along = ((away * np.broadcast_to(v, shape)).sum(axis=-1) for v in (normal, ahead))
        wall = xp.argmax(height, axis=-1)
        own = xp.take_along_axis(along, wall[..., None], axis=-1)[..., 0]
        corner = xp.where(own < 0, wall, (wall + 1) % len(vertices))
        at_corner = (xp.max(height, axis=-1) > 0) & ((own < 0) | (own > xp.take(length, wall)))
        n, v, c = (xp.take(x, k, axis=0) for x, k in ((normal, wall), (vertices, wall), (vertices, corner)))
        straight = (x - v[..., 0]) * n[..., 0] + (y - v[..., 1]) * n[..., 1]
        # Away from corners the root is that of 1.
        round_ = xp.where(at_corner, xp.ones_like(a), xp.zeros_like(a))
        flat = 1.0 - round_
        dx, dy = (x - c[..., 0]) * round_, (y - c[..., 1]) * round_
        rounded = sqrt(dx * dx + dy * dy + flat)
        return 1.0 + reach - (straight * flat + rounded * round_)

    def outside(self, place: Place, reach: Fraction) -> AnyClaim:
        """Return the claim that a ball does not enter; see `AbstractObstacle`.

        The nearest point of the polygon is in a wall, on whose free side the centre is, or it is a corner. Then the
        centre is beyond both ends of the adjacent walls.
        """
        corners = [[Fraction(x) for x in row] for row in np.asarray(self.vertices, float).tolist()]
        x, y, _ = place.weighted(place.position)
        claims = []
        for k, (a, b) in enumerate(corners):
            px, py = x - number(a) * place.weight, y - number(b) * place.weight
            after, before = corners[(k + 1) % len(corners)], corners[k - 1]
            ex, ey = after[0] - a, after[1] - b
            height = number(ey) * px - number(ex) * py
            claims.append(beyond_wall(height, number(ex * ex + ey * ey), reach, place))
            if reach > 0:
                beyond = [Claim(-(number(v[0] - a) * px + number(v[1] - b) * py)) for v in (after, before)]
                far: Any = px * px + py * py - number(reach * reach) * place.weight_sq
                claims.append(all_of([*beyond, Claim(far)]))
        return any_of(claims)


def _sense(vertices: Float[np.ndarray, "m 2"]) -> int:
    """Return 1 for corners in anticlockwise order, and −1 for clockwise ones.

    **Raises:** ValueError if the corners are not those of a convex polygon.
    """
    if not np.isfinite(vertices).all():
        raise ValueError("the vertices of a polygon must be finite numbers [m]")
    corners = [[Fraction(x) for x in row] for row in vertices.tolist()]
    count, turns, edges = len(corners), [], []
    for k in range(count):
        a, b, c = (corners[(k + i) % count] for i in range(3))
        turns.append((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]))
        edges.append((b[0] - a[0], b[1] - a[1]))
    # A polygon that turns to one side everywhere may still wind around several times, as a star does.
    sense = 1 if turns[0] > 0 else -1
    angles = np.arctan2(*np.array([[float(y), float(x)] for x, y in edges]).T)
    total = np.sum(np.mod(float(sense) * np.diff([*angles.tolist(), float(angles[0])]), 2 * np.pi))
    if not all(sense * x > 0 for x in turns) or total > 3 * np.pi:
        raise ValueError(
            "the vertices of a polygon must be the corners of a convex polygon in order, without three corners in a "
            "line: divide other areas into convex ones, or use scipy.spatial.ConvexHull"
        )
    return sense
