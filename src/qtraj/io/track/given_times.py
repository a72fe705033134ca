"""Times that the user gives for a recording without times: from a rate, or from a second file."""

import os
from pathlib import Path

import numpy as np

from qtraj.foundation.untrusted import read_text
from qtraj.io.track.column_names import find
from qtraj.io.track.delimited import content
from qtraj.io.track.known_names import COMMON, MORE
from qtraj.io.track.recorded_times import NotATimeError, Times, read_times
from qtraj.io.track.time_column import Table

NO_TIMES = (
    " If the file has no times, pass rate= (samples per second) or times= (a file with one time on a line), "
    "in a scenario rate or times under [track], on the command line --rate or --times."
)
"""The options for files without times, for error messages."""


def require_rate(rate: float | None, times: str | os.PathLike[str] | None) -> None:
    """Raise a ValueError for a rate that is not a positive finite number, or for a rate and times."""
    if rate is not None and times is not None:
        raise ValueError("rate= and times= were both given, but only one of them can specify the times")
    if rate is not None and not 0 < rate < float("inf"):
        raise ValueError(f"rate= must be a positive finite number of samples per second, but {rate!r} was given")


def given_times(
    path: Path | str, table: Table, rate: float | None, times: str | os.PathLike[str] | None
) -> tuple[str, Times] | None:
    """Return the times of each row and a description of their source; None without `rate` and `times`.

    **Raises:** ValueError if the table has times, or if the number of times is not the number of rows.
    """
    if rate is None and times is None:
        return None
    if (names := find((*COMMON["time"], *MORE["time"]), table.header)) is not None:
        raise ValueError(f"{path}: the column {names[0]!r} contains times, so omit rate= and times=")
    if rate is not None:
        return f"{rate:g} samples per second, as given", Times(np.arange(table.count) / rate, "s")
    file = Path(times or "")
    try:
        text = read_text(file)
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: there is no such file, so no times can be read") from None
    lines = content(file, text).lines
    cells = [line.replace(",", " ").split()[0] for line in lines.texts()]
    if len(cells) != table.count:
        raise ValueError(f"{path}: there are {table.count} rows, but {times} contains {len(cells)} times")
    try:
        return f"from {times}", read_times(cells)
    except NotATimeError as fault:
        raise ValueError(
            f"{file}, line {lines[fault.index][0]}: each line {fault}, but this line contains {cells[fault.index]!r}"
        ) from None
