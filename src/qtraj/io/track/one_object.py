"""Refuse a table with the positions of several vehicles, whose rows would be mixed."""

from pathlib import Path

from qtraj.io.track.column_names import squeezed
from qtraj.io.track.known_names import OBJECTS
from qtraj.io.track.time_column import Table


def require_one_object(path: Path | str, table: Table) -> None:
    """Raise a ValueError if a column with the name of a vehicle, such as MMSI, has several values that return.

    A number that differs in each row counts the rows.
    """
    known = {squeezed(name) for name in OBJECTS}
    for name in table.header:
        if squeezed(name) not in known:
            continue
        cells = table.texts(path, name)
        distinct = sorted(set(cells))
        if 1 < len(distinct) < len(cells):
            shown = ", ".join(cell.strip() for cell in distinct[:3])
            raise ValueError(
                f"{path}: the column {name!r} has {len(distinct)} different values ({shown}"
                f"{', …' if len(distinct) > 3 else ''}), so the file contains several vehicles: write the rows of "
                "one of them to a file of its own"
            )
