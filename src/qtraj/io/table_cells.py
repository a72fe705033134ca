"""Read the cells of a table as numbers and times, and name the line and the column of each fault."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from qtraj.io.column_units import Unit
from qtraj.io.delimited import Table, is_number
from qtraj.io.recorded_times import NotATimeError, Times, read_times
from qtraj.path.track import MIN_SAMPLES


def read_cells(path: Path, table: Table, names: Sequence[str], unit: Unit | None) -> tuple[Times, np.ndarray]:
    """Return the times of the first of the named columns, and the numbers (rows, columns) of the others.

    **Raises:** ValueError with file, line and column for a cell that is missing or not a finite number, for times that
    decrease, and for too few rows.
    """
    if len(table.lines) < MIN_SAMPLES:
        raise ValueError(
            f"{path}: a track needs at least {MIN_SAMPLES} rows of numbers, but there are {len(table.lines)}"
        )
    places = [table.header.index(name) for name in names]
    try:
        cells = [[row[k] for k in places] for row in table.rows(table.lines)]
        numbers = np.array([[float(table.number(cell)) for cell in row[1:]] for row in cells])
        faulty = len(cells) != len(table.lines) or not np.isfinite(numbers).all() or not all(row[0] for row in cells)
    except (ValueError, IndexError, csv.Error):
        faulty, cells, numbers = True, [], np.zeros((0, 0))
    if faulty:
        _raise_fault(path, table, places, names)
    times = _times(path, table, names[0], [table.number(row[0]) for row in cells], unit)
    return times, numbers


def _times(path: Path, table: Table, name: str, cells: list[str], unit: Unit | None) -> Times:
    try:
        times = read_times(cells, unit)
    except NotATimeError as fault:
        line = table.lines[fault.index][0]
        raise ValueError(
            f"{path}, line {line}: column {name!r} {fault}, but contains {cells[fault.index].strip()!r}"
        ) from None
    late = np.flatnonzero(np.diff(times.seconds) < 0)
    if late.size:
        k = int(late[0]) + 1
        restart = times.seconds[k] <= times.seconds[0]
        advice = ". The clock restarts there: write the part before and the part after to two files" if restart else ""
        raise ValueError(f"{_not_increasing(path, table, name, cells, k)}{advice}")
    return times._replace(cells=cells)


def same_time(path: Path, table: Table, name: str, times: Times, index: int) -> str:
    """Return the message about a sample that differs from another sample at the same time."""
    return (
        f"{_not_increasing(path, table, name, times.cells, index)}, and the two rows differ. Pass duplicates='first', "
        "'last' or 'mean' (in a scenario duplicates under [track])"
    )


def _not_increasing(path: Path, table: Table, name: str, cells: Sequence[str], index: int) -> str:
    return (
        f"{path}, line {table.lines[index][0]}: times must increase strictly, but in column {name!r} "
        f"{cells[index].strip()} follows {cells[index - 1].strip()}"
    )


def _raise_fault(path: Path, table: Table, places: Sequence[int], names: Sequence[str]) -> None:
    for number, line in table.lines:
        row = next(table.rows([(number, line)]))
        for k, (place, name) in enumerate(zip(places, names, strict=True)):
            _require_number(path, number, name, row[place].strip() if place < len(row) else "", table, k == 0)
    raise ValueError(f"{path}: a quoted cell spans several lines, but each row must be on one line")


def _require_number(path: Path, line: int, name: str, cell: str, table: Table, time: bool) -> None:
    if not cell:
        raise ValueError(f"{path}, line {line}: the cell of column {name!r} is missing")
    if time:
        return  # faults of times are found by `read_times`
    if not is_number(cell, table.decimal_comma) or not np.isfinite(float(table.number(cell))):
        raise ValueError(f"{path}, line {line}: column {name!r} must have finite numbers, but contains {cell!r}")
