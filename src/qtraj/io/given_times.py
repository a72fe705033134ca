"""Add times to a table without times: from a rate, or from a second file."""

import os
from pathlib import Path

from qtraj.io.column_names import COMMON, MORE, find
from qtraj.io.delimited import Table, content

NO_TIMES = (
    " If the file has no times, pass rate= (samples per second) or times= (a file with one time on a line), "
    "in a scenario rate or times under [track]."
)
"""The options for files without times, for error messages."""


def require_rate(rate: float | None, times: str | os.PathLike[str] | None) -> None:
    """Raise a ValueError for a rate that is not a positive finite number, or for a rate and times."""
    if rate is not None and times is not None:
        raise ValueError("rate= and times= were both given, but only one of them can specify the times")
    if rate is not None and not 0 < rate < float("inf"):
        raise ValueError(f"rate= must be a positive finite number of samples per second, but {rate!r} was given")


def described(rate: float | None, times: str | os.PathLike[str] | None) -> str:
    """Return a text about the source of given times, or an empty text."""
    return (
        f"{rate:g} samples per second, as given" if rate is not None else f"from {times}" if times is not None else ""
    )


def with_times(path: Path, table: Table, rate: float | None, times: str | os.PathLike[str] | None) -> Table:
    """Return the table with a column "time" before the others, or the same table without `rate` and `times`.

    **Raises:** ValueError if the table has times, or if the number of times is not the number of rows.
    """
    if rate is None and times is None:
        return table
    if (names := find((*COMMON["time"], *MORE["time"]), table.header)) is not None:
        raise ValueError(f"{path}: the column {names[0]!r} contains times, so omit rate= and times=")
    stamps = [repr(k / rate) for k in range(len(table.lines))] if rate is not None else _stamps(Path(times or ""))
    if len(stamps) != len(table.lines):
        raise ValueError(f"{path}: there are {len(table.lines)} rows, but {times} contains {len(stamps)} times")
    mark = "," if table.decimal_comma else "."
    cells = [f'"{stamp.replace(".", mark)}"' for stamp in stamps]
    lines = [(n, cell + table.delimiter + line.lstrip(" ")) for (n, line), cell in zip(table.lines, cells, strict=True)]
    units = None if table.units is None else ["", *table.units]
    return table._replace(header=["time", *table.header], lines=lines, units=units)


def _stamps(file: Path) -> list[str]:
    """Return the first cell of each line."""
    return [line.replace(",", " ").split()[0] for _, line in content(file).lines]
