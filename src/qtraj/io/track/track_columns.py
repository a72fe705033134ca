"""Select the columns of a recording by the user's names, otherwise by common names."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from qtraj.io.track.attitude_angles import OPTIONS as ANGLE_OPTIONS, AttitudeAngles
from qtraj.io.track.column_names import find, plain
from qtraj.io.track.compact_dates import are_date_and_clock
from qtraj.io.track.date_parts import PARTS
from qtraj.io.track.delimited import is_number
from qtraj.io.track.known_names import (
    ANGLED,
    COMMON,
    DATE_AND_CLOCK,
    FLAT,
    FLAT_VELOCITY,
    GLOBAL,
    HEIGHTS,
    MATRICES,
    MORE,
    NOT_HEIGHTS,
    UNORDERED,
    WHOLE_AND_NANOSECONDS,
)
from qtraj.io.track.missing_columns import (
    GEOGRAPHIC,
    REQUIRED,
    begun,
    first_values,
    listed,
    no_angles,
    no_globe,
    not_found,
)
from qtraj.io.track.recorded_times import CLOCK, SECONDS, in_24_hours, is_time, unit_by_size
from qtraj.io.track.tangent_plane import OPTIONS as PROJECTIONS

COUNTS = {"time": (1, 2, 6), "position": (3, 2), "velocity": (3, 2), "attitude": (4, 9), "rate": (3, 1)}
"""Numbers of columns of each quantity. Two columns of positions or velocities are horizontal, nine are a matrix."""

ANGLE_WORDS = (("roll",), ("pitch",), ("heading", "yaw"))
"""Words in the column names of roll, pitch and heading."""

UNNAMED = ("", "Unnamed: 0")
"""Names that pandas gives to an index without a name in a file."""

Columns = Mapping[str, str | Sequence[str] | None]


def _require_latitude_first(names: list[str]) -> None:
    """Raise a ValueError if the column names indicate that the longitude comes first."""
    if "lon" in names[0].lower() or "lat" in names[1].lower():
        raise ValueError(
            f"columns['position'] names {names[0]!r} before {names[1]!r}, but the latitude must come first: name "
            "latitude, longitude and height in this order"
        )


def _require_heading_last(names: list[str]) -> None:
    """Raise a ValueError if the column names indicate an order other than roll, pitch, heading."""
    for k, name in enumerate(names):
        indicated = [place for place, words in enumerate(ANGLE_WORDS) if any(word in name.lower() for word in words)]
        if indicated and k not in indicated:
            raise ValueError(
                f"columns['attitude'] names {', '.join(names)}, but the order must be roll, pitch, heading: name "
                "them in this order, whatever the sequence of the rotations"
            )


class Wanted(NamedTuple):
    """How columns are selected: the user's names, the convention of three angles, whether positions are geographic.

    `quaternion`: the order of the components whose names do not tell it.
    """

    columns: Columns
    angles: AttitudeAngles | None = None
    globe: bool = False
    quaternion: str | None = None


def choose(
    path: Path | str, header: list[str], wanted: Wanted, first: Sequence[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Return the column names of each quantity: the names of the user or, without such an entry, common names.

    `first` is the first row. Quaternions have their scalar first.

    **Raises:** ValueError for an unknown key, a wrong number of columns, three angles without `angles`, or names that
    indicate an order other than latitude, longitude, height or roll, pitch, heading. ValueError with the name of the
    file for columns that do not exist, a missing required quantity, and a quantity with incomplete columns (except the
    angular rate).
    """
    columns = wanted.columns
    if unknown := sorted(set(columns) - set(COUNTS)):
        raise ValueError(f"columns= accepts the keys {', '.join(COUNTS)}, but {unknown[0]!r} was given")
    chosen: dict[str, tuple[str, ...]] = {}
    for part in COUNTS:
        flat = len(chosen.get("position", ())) == 2 and not wanted.globe
        names = _recognised(part, header, wanted, first, flat) if part not in columns else columns[part]
        if names is None:
            if message := _missing(part, header, wanted):
                raise ValueError(f"{path}: {message}{first_values(header, first)}")
            continue
        names = (names,) if isinstance(names, str) else tuple(names)
        _require_count(part, names, wanted)
        if absent := [name for name in names if name not in header]:
            raise ValueError(
                f"{path}: there is no column {absent[0]!r}: name other columns with columns=. The columns are "
                f"{listed(header)}.{first_values(header, first)}"
            )
        _require_once(path, header, names)
        _require_order(path, part, names, wanted)
        if part == "attitude" and part in columns and wanted.quaternion == "xyzw" and len(names) == 4:
            names = (names[3], *names[:3])
        chosen[part] = names
    return chosen


def has_geographic_position(header: list[str]) -> bool:
    """Return whether a file has the columns latitude and longitude, and no position in metres."""
    return find((*COMMON["position"], *MORE["position"]), header) is None and find(GLOBAL, header) is not None


def names_times(header: list[str], first: Sequence[str]) -> bool:
    """Return whether a table has columns of times; `first` is its first row."""
    return _recognised("time", header, Wanted({}), first, False) is not None


def unordered_attitude(header: list[str]) -> tuple[str, ...] | None:
    """Return the columns of a quaternion whose names do not tell the order of the components."""
    return find(UNORDERED, header)


def _recognised(
    part: str, header: list[str], wanted: Wanted, first: Sequence[str], flat: bool
) -> tuple[str, ...] | None:
    if part == "time" and (names := _several_columns(header, first)) is not None:
        return names
    if part == "attitude" and wanted.angles is not None:
        return find(ANGLED, header)
    if part == "position" and wanted.globe:
        return find(GLOBAL, header)
    if (names := find((*COMMON[part], *MORE[part]), header)) is not None:
        return names
    if part == "time":
        return _index(header, first)
    if part == "position":
        return _flat(header, first)
    if part == "velocity" and flat:
        return find(FLAT_VELOCITY, header)
    if part == "attitude":
        return find(MATRICES, header) or _ordered(header, wanted.quaternion)
    return None


def _index(header: list[str], first: Sequence[str]) -> tuple[str, ...] | None:
    """Return the first column if it has no name and contains times, as the index of a data frame that was saved.

    Whole numbers, unless they are Unix times, count the rows.
    """
    if header[0] not in UNNAMED or header.count(header[0]) > 1 or not first:
        return None
    cell = first[0].strip()
    return (header[0],) if is_time(cell) or unit_by_size(cell) != SECONDS or _is_decimal(cell) else None


def _is_decimal(cell: str) -> bool:
    return _may_be_number(cell) and not cell.lstrip("+-").isdecimal()


def _flat(header: list[str], first: Sequence[str]) -> tuple[str, ...] | None:
    """Return the columns of a horizontal position if no other column can be its height; a text cannot be a height."""
    names = find(FLAT, header)
    if names is None:
        return None
    others = {form for form, name in plain([n for n in header if n not in names]).items()}
    texts = {name for name, cell in zip(header, first, strict=False) if cell.strip() and not _may_be_number(cell)}
    unknown = [n for n in header if n not in names and n not in texts and not set(plain([n])) & NOT_HEIGHTS]
    return None if unknown or others & HEIGHTS else names


def _may_be_number(cell: str) -> bool:
    return is_number(cell) or is_number(cell, decimal_comma=True)


def _several_columns(header: list[str], first: Sequence[str]) -> tuple[str, ...] | None:
    """Return the columns of a time that is divided, otherwise None."""
    return _date_and_clock(header, first) or find(WHOLE_AND_NANOSECONDS, header) or find(PARTS, header)


def _date_and_clock(header: list[str], first: Sequence[str]) -> tuple[str, ...] | None:
    """Return the columns of dates and of times of day, if the file has both."""
    names = find(DATE_AND_CLOCK, header)
    if names is None or len(first) < len(header):
        return None
    day, clock = (first[header.index(name)].strip() for name in names)
    with_colons = CLOCK.fullmatch(in_24_hours(clock)) is not None and ":" not in day
    return names if with_colons or are_date_and_clock(day, clock) else None


def _ordered(header: list[str], quaternion: str | None) -> tuple[str, ...] | None:
    names = None if quaternion is None else unordered_attitude(header)
    return (names[3], *names[:3]) if names is not None and quaternion == "xyzw" else names


def _missing(part: str, header: list[str], wanted: Wanted) -> str | None:
    """Return the message about a quantity without columns, or None if the quantity may be absent."""
    if part == "attitude" and wanted.angles is not None and part not in wanted.columns:
        return no_angles(listed(header))
    if part == "position" and wanted.globe:
        return no_globe(listed(header))
    if part in REQUIRED or (part not in wanted.columns and part != "rate" and begun(part, header)):
        return not_found(part, header)
    return None


def _require_count(part: str, names: tuple[str, ...], wanted: Wanted) -> None:
    if part == "attitude" and wanted.angles is None and len(names) == 3:
        raise ValueError(
            f"columns['attitude'] names three angles, {', '.join(names)}, which need a convention: pass "
            f"angles=qtraj.AttitudeAngles(sequence=…, heading=…, unit=…, body=…), or write a table [track.angles] "
            f"in the scenario. {ANGLE_OPTIONS}."
        )
    angled = part == "attitude" and wanted.angles is not None
    if len(names) not in ((3,) if angled else COUNTS[part]):
        counts = {
            "time": "1 column, or the columns of the date and of the time of day, or of year, month, …, second",
            "rate": "3 columns, or the column of the yaw rate",
            "attitude": "3 columns" if angled else "4 columns of a quaternion or 9 columns of a matrix",
        }.get(part, "3 columns, or 2 columns without the height")
        raise ValueError(f"columns[{part!r}] must name {counts}, but {list(names)!r} was given")


def _require_once(path: Path | str, header: list[str], names: Sequence[str]) -> None:
    """Raise a ValueError if one of the chosen columns is not the only column with its name."""
    if repeated := [name for name in names if header.count(name) > 1]:
        raise ValueError(
            f"{path}: {header.count(repeated[0])} columns have the name {repeated[0]!r}: rename all but one of them in "
            "the header"
        )


def _require_order(path: Path | str, part: str, names: tuple[str, ...], wanted: Wanted) -> None:
    """Raise a ValueError for names that indicate another order, or geographic coordinates instead of metres."""
    if part == "position" and wanted.globe:
        _require_latitude_first(list(names))
    if part == "position" and not wanted.globe and (message := _geographic(names)):
        raise ValueError(f"{path}: {message}")
    if part == "attitude" and wanted.angles is not None:
        _require_heading_last(list(names))


def _geographic(names: Sequence[str]) -> str | None:
    """Return a message if a column name indicates latitude or longitude instead of a position in metres."""
    for name in names:
        if GEOGRAPHIC.intersection(re.split(r"[^a-z]+", name.lower())):
            return (
                f"the column {name!r} seems to contain geographic coordinates, but positions must be in m: convert "
                f"latitude and longitude to metres first (for example with pyproj), or use {PROJECTIONS}"
            )
    return None
