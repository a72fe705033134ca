"""Define the scenario keys of the limits, one for each entry of the registry of path quantities."""

from collections.abc import Iterator
from typing import Any

from pydantic import create_model

from qtraj.design.bound import BY_SPEED, bound_of
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import COMBINED, QUANTITIES, quantity
from qtraj.path.sides import has_sides
from qtraj.scenario.keys import Part, key
from qtraj.scenario.limit_forms import EllipseTable, bound_in, kind_of_limit, valid_values
from qtraj.scenario.obstacle_part import BodyBallPart, ObstaclePart
from qtraj.scenario.own_part import OwnPart

OTHERS = ("own", "keep_out", "body")
"""Keys of [limits] that are no limits on quantities of the library."""


class LimitedPart(Part):
    """Limits on path quantities, for the whole path.

    A number limits the magnitude of a quantity. A range [lower, upper], {min = lower} or {max = upper} limits its
    signed value: longitudinal_acceleration = [-6, 2] is for braking and accelerating, and speed = {min = 5} is a lower
    limit.

    A limit may change along the way, with distances from the start of the path in metres: speed = [{from = 0, value =
    13.9}, {from = 120, value = 8.3}] are steps, where a step without a value has no limit. speed = {distance = [0,
    120], values = [13.9, 8.3], kind = "linear"} is interpolated. The values may be ranges [lower, upper]. speed =
    {column = "limit"} is a column of the recording; its cells are empty where there is no limit. The values are in the
    unit in the name of the column, or in a unit such as unit = "km/h", otherwise in the SI unit.

    A limit may hold inside areas of the horizontal plane: speed = {regions = [{polygon = [[x, y], …], value = 8.3}],
    outside = 13.9}, with corners in metres. Without outside, the list of areas alone is sufficient.

    The longitudinal and the lateral acceleration may depend on the speed: longitudinal_acceleration = {speeds = [0, 10,
    30], lower = [-6, -6, -4], upper = [3, 3, 0.8]}, where lower or upper may be omitted, or lateral_acceleration =
    {speeds = [0, 30], magnitude = [9, 7]}. combined_acceleration = {braking = 8, accelerating = 3, lateral = 9} is an
    ellipse, whose values may also be tables with speeds and a magnitude.

    A limit on a quantity of your own is a table [[limits.own]] with a name, a unit, an expression and the limit:
    expression = "velocity[2]".

    Obstacles are tables [[limits.keep_out]], such as ball = {centre = [17.0, 0.4, 0.0], radius = 1.2}, and the balls of
    the body that keeps clear of them are tables [[limits.body]].
    """

    def limits(self) -> dict[str, Any]:
        """Return the limits that are set, by name: numbers, pairs, or one of the forms above."""
        parts: Any = self
        given = self.model_dump(exclude=set(OTHERS))
        own = {part.quantity().key: bound_in(part.limit) for part in parts.own or ()}
        return {name: bound_in(value) for name, value in given.items() if value is not None} | own

    def obstacles(self) -> dict[str, Any]:
        """Return the obstacles and the body, as arguments of `Limits`."""
        parts: Any = self
        keep_out, body = parts.keep_out, parts.body
        return {
            "keep_out": None if keep_out is None else [x.obstacle() for x in keep_out],
            "body": None if not body else [(x.offset, x.radius) for x in body],
        }

    def columns(self) -> dict[str, LimitColumn]:
        """Return the columns of the limits that the recording contains, by the names of the limits."""
        return {name: x for name, x in self.limits().items() if isinstance(x, LimitColumn)}

    def _faults(self) -> Iterator[str]:
        parts: Any = self
        if parts.body is not None and not parts.keep_out:
            yield "[[limits.body]] needs obstacles, in [[limits.keep_out]]"
        names = [part.name for part in parts.own or ()]
        if repeated := [name for name in names if names.count(name) > 1]:
            yield f"there are several tables [[limits.own]] with the name {repeated[0]!r}: give one another name"
        for name, value in self.model_dump(exclude=set(OTHERS)).items():
            try:
                if not isinstance(bound := bound_in(value), LimitColumn):
                    bound_of(bound, name)
            except ValueError as error:
                text = str(error)
                yield text if name in text else f"{name}: {text}"


def _limit_key(entry: PathQuantity) -> tuple[Any, Any]:
    forms = has_sides(entry), entry.name in BY_SPEED
    return kind_of_limit(*forms) | None, key(entry.meaning, None, values=f"{valid_values(*forms)} [{entry.label}]")


_limits: dict[str, Any] = {name: _limit_key(entry) for name, entry in QUANTITIES.items()}
_limits[COMBINED] = (
    EllipseTable | None,
    key(
        quantity(COMBINED).meaning,
        None,
        values="a table {braking = …, accelerating = …, lateral = …} of positive numbers or tables by speed [m/s²]",
    ),
)
_limits["own"] = (
    list[OwnPart] | None,
    key("limits on quantities of your own", None, values="tables [[limits.own]]"),
)
_limits["keep_out"] = (
    list[ObstaclePart] | None,
    key("obstacles that the body must not enter", None, values="tables [[limits.keep_out]]"),
)
_limits["body"] = (
    list[BodyBallPart] | None,
    key("the balls of the body; default: the point of the path", None, values="tables [[limits.body]]"),
)
LimitsPart = create_model("LimitsPart", __base__=LimitedPart, __doc__=LimitedPart.__doc__, **_limits)
"""The table [limits]."""
