"""Define the scenario keys of obstacles and of the body that keeps clear of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from qtraj.design.obstacles.ball import Ball
from qtraj.design.obstacles.convex_polygon import ConvexPolygon
from qtraj.design.obstacles.cylinder import Cylinder
from qtraj.design.obstacles.ellipsoid import Ellipsoid
from qtraj.design.obstacles.half_space import HalfSpace
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key

POINT = f"{keys.THREE} [m], or rows of three for a polynomial of the time"

Point = Annotated[keys.Vector | Annotated[list[keys.Vector], Field(min_length=1)], Field(description=POINT)]


class BallPart(Part):
    """A ball."""

    centre: Point = key("the centre")
    radius: keys.Metres = key("the radius")


class CylinderPart(Part):
    """An infinite cylinder."""

    point: Point = key("a point on the axis")
    axis: keys.Vector = key("the direction of the axis")
    radius: keys.Metres = key("the radius")


class EllipsoidPart(Part):
    """An ellipsoid."""

    centre: Point = key("the centre")
    shape: keys.PositiveVector | keys.Rows = key(
        "the semi-axes along the world axes, or the matrix P of the ellipsoid",
        values="three positive finite numbers [m], or three rows of three finite numbers [m²]",
    )


class HalfSpacePart(Part):
    """All points with normal · r ≤ offset."""

    normal: keys.Vector = key("the normal, out of the obstacle")
    offset: keys.Number = key("the offset", unit="m")


KINDS = {
    "ball": Ball,
    "cylinder": Cylinder,
    "ellipsoid": Ellipsoid,
    "half_space": HalfSpace,
    "polygon": lambda vertices: ConvexPolygon(vertices),
}
"""The classes of obstacles by their keys."""


class ObstaclePart(Part):
    """An obstacle that the body must not enter: one of the keys."""

    ball: BallPart | None = key("a ball", None)
    cylinder: CylinderPart | None = key("an infinite cylinder", None)
    ellipsoid: EllipsoidPart | None = key("an ellipsoid", None)
    half_space: HalfSpacePart | None = key("all points on one side of a plane", None)
    polygon: list[keys.Pair] | None = key(
        "upright walls around a convex polygon", None, values="a list of at least three corners [x, y] [m], in order"
    )

    def obstacle(self) -> AbstractObstacle:
        """Return the obstacle."""
        name = self.given(*KINDS)[0]
        part: Any = getattr(self, name)
        return KINDS[name](part) if name == "polygon" else KINDS[name](**part.model_dump())

    def _faults(self) -> Iterator[str]:
        given = self.given(*KINDS)
        if len(given) != 1:
            found = f"several obstacles ({', '.join(given)})" if given else "no obstacle"
            yield f"there is {found} in one table [[limits.keep_out]]: specify one of {', '.join(KINDS)}"
        else:
            try:
                self.obstacle()
            except ValueError as error:
                yield str(error)


class BodyBallPart(Part):
    """A ball of the body, which moves with the upright frame of the path."""

    offset: keys.Number | keys.Vector = key(
        "the centre relative to the position of the path",
        0.0,
        values="a finite number [m] in the direction of travel, or three [m]: forwards, to the left and upwards",
    )
    radius: keys.NotNegative = key("the radius", unit="m")
