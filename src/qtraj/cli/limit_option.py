"""Parse the option `--limit` of `qtraj route` and `qtraj retime`.

The value of a limit is a number, two sides LOWER:UPPER, steps along the way such as 13.9,8.3@120 (8.3 from 120 m on;
"none" is no limit), values at speeds such as 3@0m/s,0.8@30m/s, linear in between, or column:NAME for a column of the
recording, whose unit may follow, as in column:maxspeed:km/h.
"""

import math
from typing import TYPE_CHECKING, Any

from qtraj.foundation.suggestion import suggestion

if TYPE_CHECKING:
    from qtraj.design.along import Along
    from qtraj.design.by_speed import BySpeed
    from qtraj.io.track.limit_columns import LimitColumn

Number = float | tuple[float | None, float | None]
"""A limit on the magnitude, or on two sides of the signed value."""

FORMS = (
    "NAME=VALUE, NAME=LOWER:UPPER, NAME=VALUE,VALUE@DISTANCE, NAME=VALUE@SPEEDm/s,VALUE@SPEEDm/s or NAME=column:COLUMN"
)

HELP = (
    "A limit in SI units, such as speed=13.9, or longitudinal_acceleration=-6:2 for its two sides; speed=13.9,8.3@120 "
    "changes to 8.3 m/s at 120 m along the way, longitudinal_acceleration=-6:3@0m/s,-4:0.8@30m/s depends on the speed, "
    "and speed=column:maxspeed:km/h is a column of the recording and its unit. Overrides the scenario; repeatable."
)
COLUMN, BY_SPEED = "column:", "m/s"


def limits(texts: list[str] | None) -> "dict[str, Number | Along | BySpeed | LimitColumn]":
    """Parse the values of the option.

    **Raises:** ValueError for an unknown or repeated name, or a value of another form.
    """
    from qtraj.path.quantity import COMBINED, QUANTITIES  # imported here, so that --help is fast

    found: dict[str, Any] = {}
    for text in texts or []:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise ValueError(f"--limit needs NAME=VALUE, such as speed=13.9, but {text!r} was given")
        if name in found:
            raise ValueError(f"--limit {name} was given more than once")
        if name == COMBINED:
            raise ValueError(
                f"--limit: {name} is an ellipse: write {name} = {{braking = …, accelerating = …, lateral = …}} in the "
                "table [limits] of a scenario"
            )
        if name not in QUANTITIES:
            raise ValueError(
                f"--limit: unknown limit {name!r}; {suggestion(name, list(QUANTITIES), 'limits')}. Own quantities and "
                "obstacles need more than a number: write [[limits.own]] and [[limits.keep_out]] in a scenario"
            )
        found[name] = _value(name, value, text)
    return found


def _value(name: str, value: str, text: str) -> "Number | Along | BySpeed | LimitColumn":
    if value.startswith(COLUMN):
        return _column(name, value.removeprefix(COLUMN).strip(), text)
    if "@" in value and BY_SPEED in value:
        return _by_speed(name, value, text)
    return _steps(name, value, text) if "," in value or "@" in value else _constant(name, value, text)


def _column(limit: str, column: str, text: str) -> "LimitColumn":
    from qtraj.io.track.column_units import unit_of
    from qtraj.io.track.limit_columns import LimitColumn

    if not column:
        raise ValueError(f"--limit {limit}=column: needs the name of a column, but {text!r} was given")
    name, _, unit = column.rpartition(":")
    return LimitColumn(name, unit) if name and unit_of(unit) else LimitColumn(column)


def _constant(name: str, value: str, text: str) -> Number:
    lower, colon, upper = (part.strip() for part in value.partition(":"))
    if not colon:
        limit = _number(value, text)
        if not limit > 0:
            raise ValueError(f"--limit {name} must be positive and finite, but {value} was given")
        return limit
    if not lower and not upper:
        raise ValueError(f"--limit {name} needs a number before or after the colon, but {text!r} was given")
    return _number(lower, text) if lower else None, _number(upper, text) if upper else None


def _steps(name: str, value: str, text: str) -> "Along":
    """Return steps VALUE@DISTANCE; the distance of the first one is 0 unless it is given."""
    from qtraj.design.along import Along
    from qtraj.design.bound import bound_of

    distances, values = [], []
    for k, step in enumerate(value.split(",")):
        limit, at, start = (part.strip() for part in step.partition("@"))
        if not limit or bool(at) != bool(start) or (k and not at) or (at and not _is_number(start)):
            raise ValueError(
                f"--limit {name} needs steps such as 13.9,8.3@120, each with a value and the distance in metres, "
                "without a unit, from which it holds, or values at speeds in m/s such as 3@0m/s,0.8@30m/s, but "
                f"{text!r} was given"
            )
        distances.append(_number(start, text) if at else 0.0)
        values.append(None if limit == "none" else _constant(name, limit, text))
    if any(isinstance(x, tuple) for x in values):
        values = [(None, None) if x is None else x for x in values]
    try:
        along = Along(distances, values)
        bound_of(along, name)
    except ValueError as error:
        raise ValueError(f"--limit {name}: {error}") from None
    return along


def _by_speed(name: str, value: str, text: str) -> "BySpeed":
    """Return values VALUE@SPEEDm/s, all of which are magnitudes, or have the same sides."""
    from qtraj.design.bound import bound_of
    from qtraj.design.by_speed import BySpeed

    speeds, values = [], []
    for point in value.split(","):
        limit, _, speed = (part.strip() for part in point.partition("@"))
        if not limit or not speed.endswith(BY_SPEED):
            raise ValueError(
                f"--limit {name} needs values at speeds such as 3@0m/s,0.8@30m/s, each with its speed in m/s, but "
                f"{text!r} was given"
            )
        speeds.append(_number(speed.removesuffix(BY_SPEED).strip(), text))
        own = _constant(name, limit, text)
        values.append(own if isinstance(own, tuple) else (own,))
    columns = list(zip(*values, strict=False))
    known = [[x is not None for x in column] for column in columns]
    if len({len(x) for x in values}) > 1 or any(any(x) and not all(x) for x in known):
        raise ValueError(f"--limit {name} needs the same sides at all speeds, but {text!r} was given")
    kinds = ("magnitude",) if len(columns) == 1 else ("lower", "upper")
    sides: Any = {kind: column for kind, column, x in zip(kinds, columns, known, strict=True) if all(x)}
    try:
        found = BySpeed(speeds, **sides)
        bound_of(found, name)
    except ValueError as error:
        raise ValueError(f"--limit {name}: {error}") from None
    return found


def _is_number(value: str) -> bool:
    try:
        return math.isfinite(float(value))
    except ValueError:
        return False


def _number(value: str, text: str) -> float:
    if not _is_number(value):
        raise ValueError(
            f"--limit needs {FORMS} with finite numbers, such as speed=13.9 or longitudinal_acceleration=-6:2, but "
            f"{text!r} was given"
        )
    return float(value)
