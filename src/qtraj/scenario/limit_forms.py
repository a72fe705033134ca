"""Define the forms that a limit may have in a scenario: a number, a range, steps, tables, a column and areas."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag

from qtraj.design.along import Along
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import FIELDS, Ellipse
from qtraj.design.regions import Regions
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.scenario import keys


def bound_in(value: Any) -> Any:
    """Return the limit that a value of a key means: a number, a pair, or an object such as `Along`."""
    form = _form(value)
    if form == "ellipse":
        if missing := [name for name in FIELDS if name not in value]:
            raise ValueError(f"an ellipse must have {', '.join(FIELDS)}, but {missing[0]} is missing")
        return Ellipse(*(bound_in(value[name]) for name in FIELDS))
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


def kind_of_limit(sides: bool, by_speed: bool = False) -> Any:
    """Return the type of a key of a limit, which may have two `sides`, or depend on the speed."""
    forms: Any = Annotated[keys.Positive, Tag("number")] | Steps | Table | Column | Areas | Inside
    if sides:
        forms = forms | Annotated[keys.Range, Tag("range")]
    if by_speed:
        forms = forms | BySpeedTable
    return Annotated[forms, Discriminator(_form)]


def valid_values(sides: bool, by_speed: bool = False) -> str:
    """Return what the values of such a key may be, as text."""
    return (
        f"a positive finite number{', a range' if sides else ''}, steps [{{from = …, value = …}}, …], a column "
        f"{{column = …}}{', a table {speeds = …, magnitude = …}' if by_speed else ''} or areas [{{polygon = …, value = "
        "…}, …]"
    )
