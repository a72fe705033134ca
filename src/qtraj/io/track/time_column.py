"""Read the column of the times of a table, or its two columns of dates and times of day."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.io.track.column_names import find
from qtraj.io.track.column_table import ColumnTable
from qtraj.io.track.column_units import SPELLINGS, Unit
from qtraj.io.track.compact_dates import all_joined, are_date_and_clock, is_compact, is_date, joined
from qtraj.io.track.date_parts import LIMITS, joined_parts
from qtraj.io.track.known_names import DATE_AND_CLOCK, WHOLE_AND_NANOSECONDS
from qtraj.io.track.recorded_times import (
    SECONDS,
    NotATimeError,
    Times,
    from_integers,
    is_time,
    read_times,
    unit_by_size,
)
from qtraj.io.track.text_table import TextTable

Table = TextTable | ColumnTable


def time_column(path: Path | str, table: Table, names: Sequence[str], unit: Unit | None) -> Times:
    """Return the times in one column, or in two: dates and times of day, or whole seconds and nanoseconds.

    **Raises:** ValueError with file, line and column for a cell that is not a time.
    """
    if len(names) == 1:
        quick = _of_datetimes(table, names[0]) or _of_numbers(table, names[0], unit)
        if quick is not None:
            return quick
        cells = table.texts(path, names[0])
        return _read(path, table, names, (all_joined(cells) if unit is None else None) or cells, unit)
    if len(names) == len(LIMITS):
        return _read(path, table, names, _joined(path, table, names), unit)
    if not _are_dates(table, names) and (whole := _whole_numbers(path, table, names)) is not None:
        _require_nanoseconds(path, table, names, whole[:, 1])
        return from_integers(whole[:, 0] * 10**9 + whole[:, 1], SPELLINGS["ns"])
    cells = [joined(day, clock) for day, clock in zip(*(table.texts(path, name) for name in names), strict=True)]
    if not is_time(cells[0]):
        raise ValueError(
            f"{path}, {table.place(0)}: the columns {' and '.join(map(repr, names))} must have dates such as "
            "2026-05-06 or 20260506 and times of day such as 09:30:00 or 093000, but contain "
            f"{' and '.join(repr(_first(table, name).strip()) for name in names)}: convert them, or name one column "
            'with columns={"time": ...}'
        )
    return _read(path, table, names, cells, unit)


def _joined(path: Path | str, table: Table, names: Sequence[str]) -> list[str]:
    """Return year, month, day, hour, minute and second of each row as one text."""
    rows = list(zip(*(table.texts(path, name) for name in names), strict=True))
    cells = [joined_parts(row) for row in rows]
    for k, (row, cell) in enumerate(zip(rows, cells, strict=True)):
        if cell is None:
            found = ", ".join(part.strip() for part in row)
            raise ValueError(
                f"{path}, {table.place(k)}: the columns {', '.join(names)} must have year, month, day, hour, minute "
                f"and second, but contain {found}: correct the cells, or name one column with "
                'columns={"time": ...}'
            )
    return [cell for cell in cells if cell is not None]


def _read(path: Path | str, table: Table, names: Sequence[str], cells: list[str], unit: Unit | None) -> Times:
    try:
        return read_times(cells, unit)
    except NotATimeError as fault:
        raise ValueError(
            f"{path}, {table.place(fault.index)}: column {names[-1]!r} {fault}, but contains "
            f"{cells[fault.index].strip()!r}: correct the cell, or delete the row"
        ) from None


def times_and_numbers(
    path: Path | str, table: Table, names: Sequence[str], unit: Unit | None, others: Sequence[str]
) -> tuple[Times, np.ndarray]:
    """Return the times, and the columns `others` as an array (rows, columns).

    All columns are read at once if the times are numbers in seconds.

    **Raises:** ValueError with file, line and column for a cell that is missing, not a time or not a finite number.
    """
    if len(names) == 1 and _in_seconds(table, names[0], unit):
        values = table.quick([*names, *others])
        if values is not None and np.isfinite(values).all():
            return Times(values[:, 0], "s"), values[:, 1:]
    numbers = table.numbers(path, others)
    return time_column(path, table, names, unit), numbers


def by_speeds(
    times: Times, table: Table, name: str, positions: np.ndarray, velocities: np.ndarray, globe: bool
) -> Times:
    """Return the times in ms, µs or ns if whole numbers without a unit agree with the speeds only in this unit.

    The unit is the median ratio of the distances between positions (n, 3) to the distances at the recorded speeds. It
    is accepted within a factor of 2. Geographic positions (`globe`) are not compared.
    """
    if globe or times.unit != "s" or times.origin or not (times.seconds == np.round(times.seconds)).all():
        return times
    ratio = _speed_ratio(times.seconds, positions, velocities)
    spelling = next((s for s in ("ms", "us", "ns") if 0.5 < ratio / float(SPELLINGS[s].factor) < 2), None)
    whole = None if spelling is None else table.quick([name], int)
    if spelling is None or whole is None:
        return times
    return from_integers(whole[:, 0], SPELLINGS[spelling])._replace(note="by the recorded speeds")


def _speed_ratio(seconds: np.ndarray, positions: np.ndarray, velocities: np.ndarray) -> float:
    """Return the median ratio of the distances to the distances at the recorded speeds; NaN for a standstill."""
    speeds = np.linalg.norm(velocities, axis=1)
    travelled = np.diff(seconds) * (speeds[1:] + speeds[:-1]) / 2
    moving = travelled > 0
    if not moving.any():
        return float("nan")
    return float(np.median(np.linalg.norm(np.diff(positions, axis=0), axis=1)[moving] / travelled[moving]))


def _first(table: Table, name: str) -> str:
    row, place = table.row(0), table.header.index(name)
    return row[place] if place < len(row) else ""


def _are_dates(table: Table, names: Sequence[str]) -> bool:
    """Return whether two columns are a date and a time of day, and not whole seconds and nanoseconds."""
    day, clock = (_first(table, name) for name in names)
    if find(WHOLE_AND_NANOSECONDS, names) is not None:
        return False
    return is_date(day) or (find(DATE_AND_CLOCK, names) is not None and are_date_and_clock(day, clock))


def _require_nanoseconds(path: Path | str, table: Table, names: Sequence[str], values: np.ndarray) -> None:
    """Raise a ValueError for a value that is not the part of a second in nanoseconds."""
    for k in np.flatnonzero((values < 0) | (values >= 10**9))[:1].tolist():
        raise ValueError(
            f"{path}, {table.place(k)}: two columns of whole numbers are whole seconds and nanoseconds, but the column "
            f"{names[1]!r} contains {values[k]}, and nanoseconds are less than 1000000000: name one column with "
            'columns={"time": ...}'
        )


def _whole_numbers(path: Path | str, table: Table, names: Sequence[str]) -> np.ndarray | None:
    """Return columns of whole numbers as an array (rows, columns), or None if a cell is another text."""
    quick = table.quick(names, int)
    if quick is not None or not all(_first(table, name).strip().isdecimal() for name in names):
        return quick
    cells = [[cell.strip() for cell in table.texts(path, name)] for name in names]
    if not all(cell.isdecimal() for column in cells for cell in column):
        return None
    return np.array([[int(cell) for cell in column] for column in cells]).T


def _in_seconds(table: Table, name: str, unit: Unit | None) -> bool:
    first = _first(table, name)
    if not first or is_time(first) or (unit is None and is_compact(first)):
        return False
    return (unit or unit_by_size(first)) == SECONDS


def _of_numbers(table: Table, name: str, unit: Unit | None) -> Times | None:
    """Return the times of a column of simple numbers, otherwise None."""
    first = _first(table, name)
    if not first or is_time(first) or (unit is None and is_compact(first)):
        return None
    unit = unit or unit_by_size(first)
    values = table.quick([name], float if unit == SECONDS else int)
    if values is None or not np.isfinite(values).all():
        return None
    return Times(values[:, 0], "s") if unit == SECONDS else from_integers(values[:, 0], unit)


def _of_datetimes(table: Table, name: str) -> Times | None:
    """Return the times of a column of NumPy dates or durations, otherwise None."""
    column: Any = table.columns[name] if isinstance(table, ColumnTable) else None
    if column is None or column.dtype.kind not in "Mm" or np.isnat(column).any():
        return None
    dates = column.dtype.kind == "M"
    nanoseconds = (column - column[0] if dates else column).astype("m8[ns]").astype(np.int64)
    unit = "date and time" if dates else "durations"
    return Times(nanoseconds / 10**9, unit, str(column[0]).rstrip("0").rstrip(".") if dates else None)
