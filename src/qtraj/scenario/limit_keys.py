"""Define the scenario keys of the limits, one for each entry of the registry of path quantities."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag, create_model

from qtraj.design.along import Along
from qtraj.design.bound import BY_SPEED, bound_of
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import FIELDS, Ellipse
from qtraj.design.regions import Regions
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import COMBINED, QUANTITIES, quantity
from qtraj.path.sides import has_sides
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key
from qtraj.scenario.obstacle_part import BodyBallPart, ObstaclePart

OBSTACLES = ("keep_out", "body")
"""Keys of [limits] that are no limits on quantities."""


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

    Obstacles are tables [[limits.keep_out]], such as ball = {centre = [17.0, 0.4, 0.0], radius = 1.2}, and the balls of
    the body that keeps clear of them are tables [[limits.body]].
    """

    def limits(self) -> dict[str, Any]:
        """Return the limits that are set, by name: numbers, pairs, or one of the forms above."""
        given = self.model_dump(exclude=set(OBSTACLES))
        return {name: _bound(value) for name, value in given.items() if value is not None}

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
        for name, value in self.model_dump(exclude=set(OBSTACLES)).items():
            try:
                if not isinstance(bound := _bound(value), LimitColumn):
                    bound_of(bound, name)
            except ValueError as error:
                text = str(error)
                yield text if name in text else f"{name}: {text}"


def _bound(value: Any) -> Any:
    form = _form(value)
    if form == "ellipse":
        if missing := [name for name in FIELDS if name not in value]:
            raise ValueError(f"an ellipse must have {', '.join(FIELDS)}, but {missing[0]} is missing")
        return Ellipse(*(_bound(value[name]) for name in FIELDS))
    if form == "by speed":
        sides = {name: value.get(name) for name in ("lower", "upper", "magnitude")}
        return BySpeed(value["speeds"], **sides)
    if form == "along":
        return Along(value.get("distance", ()), value.get("values", ()), value.get("kind", "step"))
    if form == "column":
        return LimitColumn(**value)
    if form in ("areas", "regions"):
        areas, outside = (value, None) if form == "areas" else (value["regions"], value.get("outside"))
        return _regions(areas, outside)
    if form == "steps":
        if missing := [step for step in value if "from" not in step]:
            raise ValueError(f"every step needs the key 'from', where it starts [m], but one is {missing[0]}")
        values = [_sides(step.get("value")) for step in value]
        if any(isinstance(x, tuple) for x in values):
            values = [x if isinstance(x, tuple) else (None, None) if x is None else x for x in values]
        return Along([step["from"] for step in value], values)
    return _sides(value)


def _regions(areas: Any, outside: Any) -> Regions:
    if not isinstance(areas, list) or not all(isinstance(area, dict) for area in areas):
        raise ValueError(f"regions must be a list of areas {{polygon = …, value = …}}, but {areas!r} was given")
    if missing := [area for area in areas if not area.keys() >= {"polygon", "value"}]:
        raise ValueError(
            f"every area needs the keys 'polygon' and 'value', but one has {', '.join(missing[0]) or 'none'}"
        )
    values = [None if x is None else _sides(x) for x in (*(area["value"] for area in areas), outside)]
    if any(isinstance(x, tuple) for x in values):
        values = [x if isinstance(x, tuple) else (None, None) if x is None else x for x in values]
    *inside, outside = values
    return Regions([(area["polygon"], x) for area, x in zip(areas, inside, strict=True)], outside)


def _sides(value: Any) -> Any:
    """Return a number, or a range as a pair."""
    if isinstance(value, dict):
        return value.get("min"), value.get("max")
    return tuple(value) if isinstance(value, list) else value


def _form(value: Any) -> str:
    """Return which of the forms of a limit a value has."""
    if isinstance(value, list) and value and all(isinstance(x, dict) for x in value):
        return "areas" if any("polygon" in x for x in value) else "steps"
    if isinstance(value, dict) and "column" in value:
        return "column"
    if isinstance(value, dict) and "regions" in value:
        return "regions"
    if isinstance(value, dict) and value.keys() & {"distance", "values"}:
        return "along"
    if isinstance(value, dict) and value.keys() & {"speeds", *FIELDS}:
        return "by speed" if "speeds" in value else "ellipse"
    return "range" if isinstance(value, list | dict) else "number"


Value = keys.Number | keys.Range
Steps = Annotated[list[dict[Literal["from", "value"], Value]], Tag("steps")]
Table = Annotated[dict[Literal["distance", "values", "kind"], str | list[Value]], Tag("along")]
BySpeedTable = Annotated[dict[Literal["speeds", "lower", "upper", "magnitude"], list[keys.Number]], Tag("by speed")]
EllipseTable = dict[Literal["braking", "accelerating", "lateral"], keys.Positive | BySpeedTable]
Column = Annotated[dict[Literal["column", "unit"], keys.Text], Tag("column")]
Area = dict[Literal["polygon", "value"], list[keys.Pair] | Value]
Areas = Annotated[list[Area], Tag("areas")]
Inside = Annotated[dict[Literal["regions", "outside"], list[Area] | Value], Tag("regions")]


def _limit_key(entry: PathQuantity) -> tuple[Any, Any]:
    forms: Any = Annotated[keys.Positive, Tag("number")] | Steps | Table | Column | Areas | Inside
    if has_sides(entry):
        forms = forms | Annotated[keys.Range, Tag("range")]
    if entry.name in BY_SPEED:
        forms = forms | BySpeedTable
    kind: Any = Annotated[forms, Discriminator(_form)]
    by_speed = ", a table {speeds = …, magnitude = …}" if entry.name in BY_SPEED else ""
    values = (
        f"a positive finite number{', a range' if has_sides(entry) else ''}, steps [{{from = …, value = …}}, …], a "
        f"column {{column = …}}{by_speed} or areas [{{polygon = …, value = …}}, …] [{entry.label}]"
    )
    return kind | None, key(entry.meaning, None, values=values)


_limits: dict[str, Any] = {name: _limit_key(entry) for name, entry in QUANTITIES.items()}
_limits[COMBINED] = (
    EllipseTable | None,
    key(
        quantity(COMBINED).meaning,
        None,
        values="a table {braking = …, accelerating = …, lateral = …} of positive numbers or tables by speed [m/s²]",
    ),
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
