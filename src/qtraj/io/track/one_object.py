"""Refuse a table with the positions of several vehicles, whose rows would be mixed."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from qtraj.io.track.column_names import squeezed
from qtraj.io.track.known_names import OBJECTS
from qtraj.io.track.time_column import Table

SHIPS = ("mmsi", "imo")
"""Columns that never count rows."""

ANY = "id"
"""The column that may also count messages, laps or parts of a recording of one vehicle."""


def require_one_object(path: Path | str, table: Table) -> None:
    """Raise a ValueError if a column with the name of a vehicle, such as MMSI, has the values of several vehicles.

    Empty cells do not count. Values that differ in each row count the rows, except for ships. The values of a column
    `id` belong to several vehicles only if a value returns after another one; otherwise they may count messages or
    laps.
    """
    known = {squeezed(name) for name in OBJECTS}
    for name in table.header:
        kind = squeezed(name)
        if kind not in known:
            continue
        values = [value for value in map(_plain, table.cells(path, name)) if value]
        if _are_several(kind, values):
            distinct = list(dict.fromkeys(values))
            raise ValueError(
                f"{path}: the column {name!r} has {len(distinct)} different values ({', '.join(distinct[:3])}"
                f"{', …' if len(distinct) > 3 else ''}), so the file contains several vehicles: write the rows of "
                "one of them to a file of its own. If the column does not name vehicles, remove it"
            )


def _are_several(kind: str, values: Sequence[str]) -> bool:
    """Return whether the values in a column belong to several vehicles."""
    count = len(set(values))
    if count < 2 or (count == len(values) and kind not in SHIPS):
        return False
    return kind != ANY or sum(1 for _ in groupby(values)) > count


def _plain(cell: str) -> str:
    """Return a cell without spaces, and a whole number without a decimal point."""
    text = cell.strip()
    whole, point, rest = text.partition(".")
    return whole if point and whole.isdecimal() and not rest.strip("0") else text
