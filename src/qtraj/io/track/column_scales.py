"""Units of the chosen columns of a recording: from `units=`, from the column names, or the units of a track."""

import math
from collections.abc import Mapping, Sequence

from qtraj.io.track.attitude_angles import AttitudeAngles
from qtraj.io.track.column_names import unit_in
from qtraj.io.track.column_units import SPELLINGS, Unit, unit_of

KINDS = {"time": "time", "position": "length", "velocity": "speed", "rate": "angular rate"}
DEFAULTS = {"time": "s", "position": "m", "velocity": "m/s", "attitude": "a quaternion", "rate": "rad/s"}

Units = Mapping[str, str]


def scales(
    part: str, names: Sequence[str], units: Units, rows: Mapping[str, str], globe: bool, angles: AttitudeAngles | None
) -> list[Unit | None]:
    """Return the unit of each column of a quantity; None for the unit of a track, or degrees for a geographic angle.

    `units` maps quantities to units, and `rows` column names to the units in a row below the header.

    **Raises:** ValueError for an unknown quantity or unit, a unit of another kind, and columns of which only some have
    a unit that differs from the unit of a track.
    """
    kinds = _kinds(part, len(names), globe, angles is not None)
    if part in units:
        return _by_user(part, units[part], kinds, [unit_of_column(name, rows) for name in names])
    found = [meant(unit_of_column(name, rows), kind) for name, kind in zip(names, kinds, strict=True)]
    for k, (name, item) in enumerate(zip(names, found, strict=True)):
        if item is not None and item[1].kind != kinds[k] and is_wrong(name, item[0]):
            _raise_other_kind(part, name, item, angles)
        if item is not None and item[1].kind != kinds[k]:
            found[k] = None
        if part == "attitude" and angles is not None and item is not None and _radians(item[1]) != angles.unit:
            raise ValueError(
                f"the column {name!r} is in {item[0]}, but the attitude must be in {angles.unit}: pass an "
                f"AttitudeAngles with the unit of the column, or convert it first"
            )
    result = [None if item is None else item[1] for item in found]
    if part in ("position", "velocity", "rate"):
        _require_one(part, names, found, kinds)
    return result


def require_units(units: Units) -> None:
    """Raise a ValueError for a quantity that has no unit, or an unknown unit."""
    for part, text in units.items():
        if part not in KINDS:
            raise ValueError(f"units= accepts the keys {', '.join(KINDS)}, but {part!r} was given")
        if not isinstance(text, str) or unit_of(text) is None:
            raise ValueError(f"units[{part!r}] must be {_known(KINDS[part])}, but {text!r} was given")


def _kinds(part: str, count: int, globe: bool, angled: bool) -> list[str]:
    if part == "position" and globe:
        return ["angle", "angle", "length"][:count]
    return ["angle" if angled and part == "attitude" else KINDS.get(part, "none")] * count


def _by_user(part: str, text: str, kinds: list[str], found: Sequence[tuple[str, Unit] | None]) -> list[Unit | None]:
    """Return the unit of the user for the columns of its kind; the others, such as a height, have their own."""
    unit = unit_of(text)
    if unit is None or unit.kind not in kinds:
        raise ValueError(f"units[{part!r}] must be {_known(kinds[0])}, but {text!r} was given")
    own = [
        item[1] if item is not None and item[1].kind == kind else None for item, kind in zip(found, kinds, strict=True)
    ]
    return [unit if kind == unit.kind else other for kind, other in zip(kinds, own, strict=True)]


def meant(item: tuple[str, Unit] | None, kind: str) -> tuple[str, Unit] | None:
    """Return a unit and its text; `ms` of a speed, as in `vx_ms`, is m/s, because only times are in milliseconds."""
    return (item[0], SPELLINGS["m/s"]) if kind == "speed" and item is not None and item[0].lower() == "ms" else item


def unit_of_column(name: str, rows: Mapping[str, str]) -> tuple[str, Unit] | None:
    """Return the unit of a column and its text: in its name, or in the row of units below the header."""
    if item := unit_in(name):
        return item
    unit = unit_of(rows.get(name, ""))
    return None if unit is None else (rows[name], unit)


def is_wrong(name: str, text: str) -> bool:
    """Return whether a unit of another kind is in brackets or has several letters, and so cannot be a name."""
    return len(text) > 1 or "[" in name or "(" in name


def _raise_other_kind(part: str, name: str, item: tuple[str, Unit], angles: AttitudeAngles | None) -> None:
    expected = angles.unit if part == "attitude" and angles is not None else DEFAULTS[part]
    be = expected if expected.startswith("a ") else f"in {expected}"
    raise ValueError(
        f"the column {name!r} is in {item[0]}, but the {part} must be {be}: convert it first, or name other columns "
        f'with columns={{"{part}": ...}}'
    )


def _require_one(
    part: str, names: Sequence[str], found: Sequence[tuple[str, Unit] | None], kinds: Sequence[str]
) -> None:
    """Raise a ValueError if a column has another unit than a track, and a column of the same kind has none."""
    for kind in set(kinds):
        same = [(name, item) for name, item, other in zip(names, found, kinds, strict=True) if other == kind]
        other = [(name, item) for name, item in same if item is not None and not math.isclose(item[1].factor, 1)]
        bare = [name for name, item in same if item is None]
        if other and bare:
            name, item = other[0]
            raise ValueError(
                f"the column {name!r} is in {item[0]}, but the column {bare[0]!r} of the {part} has no unit: pass "
                f'units={{"{part}": "{item[0]}"}}, or give each column its unit'
            )


def _radians(unit: Unit) -> str:
    return "rad" if unit.symbol == "rad" else "deg"


def _known(kind: str) -> str:
    symbols = list(dict.fromkeys(unit.symbol for unit in SPELLINGS.values() if unit.kind == kind))
    return f"{', '.join(symbols[:-1])} or {symbols[-1]}"
