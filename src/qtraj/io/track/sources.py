"""Find out by its content what a recording is, and return its table."""

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from qtraj.foundation.argument import described
from qtraj.foundation.untrusted import decoded, read_bytes
from qtraj.io.track import frames, gpx, nmea
from qtraj.io.track.column_names import plain
from qtraj.io.track.delimited import Content, are_numbers, content, find_table, header_in_comment, is_number
from qtraj.io.track.kitti_poses import COLUMNS as KITTI_COLUMNS, POSITION, ROTATION, is_kitti
from qtraj.io.track.known_names import HEIGHTS, NOT_HEIGHTS
from qtraj.io.track.lines import UTF16
from qtraj.io.track.other_formats import require_known_format
from qtraj.io.track.reading import Reading
from qtraj.io.track.recorded_line import RecordedLine
from qtraj.io.track.recorded_times import Times
from qtraj.io.track.text_table import TextTable
from qtraj.io.track.time_column import Table

TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
TUM_UNORDERED = (*TUM_COLUMNS[:4], "q1", "q2", "q3", "q4")


class Source(NamedTuple):
    """A table with a recording.

    `name`: the file, for messages. `columns`: the columns of quantities that the format defines. `kind`: "table",
    "kitti", "gpx" or "nmea". `breaks`: the first rows of further segments. `times`: times that are not in the table,
    with their description. `notes`: what was left out. `line`: heading and curvature of a race line.
    """

    name: Path | str
    table: Table
    columns: Mapping[str, Sequence[str] | None] = MappingProxyType({})
    kind: str = "table"
    breaks: Sequence[int] = ()
    times: tuple[str, Times] | None = None
    notes: tuple[str, ...] = ()
    line: RecordedLine | None = None


def find_source(file: Any, reading: Reading) -> Source:
    """Return the table in a file, or of another library.

    **Raises:** FileNotFoundError for a missing file; ValueError for a file that is not understood.
    """
    if frames.is_frame(file):
        return Source("the table", frames.table_of(file))
    if not isinstance(file, str | os.PathLike) or not os.fspath(file):
        raise ValueError(
            "file must be the name of a file, a data frame of pandas or polars, or a dataset of xarray, but "
            f"{described(file)} was given"
        )
    path = Path(file)
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: there is no such file, so no track can be read") from None
    if gpx.is_gpx(data):
        table, breaks, notes = gpx.read_gpx(path, data, reading.timed)
        return Source(path, table, kind="gpx", breaks=breaks, notes=notes)
    if nmea.is_nmea(data):
        table, notes = nmea.read_nmea(path, data)
        return Source(path, table, kind="nmea", notes=notes)
    require_known_format(path, data)
    return _text_source(path, content(path, _decoded(path, data)), reading)


def _decoded(path: Path, data: bytes) -> str:
    """Return a text in UTF-8, or in UTF-16 if it begins with a byte order mark."""
    try:
        return data.decode("utf-16") if data.startswith(UTF16) else decoded(path, data)
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text in UTF-16, although it begins so: export it in UTF-8") from None
    except ValueError as error:
        raise ValueError(f"{error}: export the recording as a text file in UTF-8, such as CSV") from None


def _text_source(path: Path, found: Content, reading: Reading) -> Source:
    if not reading.columns and is_kitti(found):
        columns = {"position": POSITION, "attitude": ROTATION}
        return Source(path, TextTable(KITTI_COLUMNS, found.lines, " "), columns, "kitti")
    if _is_tum(path, found, reading.named) and not are_numbers(reading.named):
        if reading.columns or reading.angles is not None or reading.plane is not None:
            raise ValueError(
                f"{path}: columns=, angles= and projection= are for CSV files, but this is a TUM trajectory, which has "
                "positions in metres, quaternions and no header row"
            )
        first = reading.quaternion == "wxyz"
        columns = {"attitude": TUM_UNORDERED[4:]} if first else {}
        return Source(path, TextTable(list(TUM_UNORDERED if first else TUM_COLUMNS), found.lines, " "), columns)
    try:
        return Source(path, find_table(path, found, reading.named))
    except csv.Error as error:
        raise ValueError(f"{path}: the table cannot be read ({error})") from error


def _is_tum(path: Path, found: Content, named: Sequence[str]) -> bool:
    """Return whether the file is a TUM trajectory: numbers between spaces, and no header with other names."""
    cells = found.lines[0][1].split()
    if not all(map(is_number, cells)) or not (len(cells) == 8 or path.suffix.lower() == ".tum"):
        return False
    header = header_in_comment(found, named)
    if header is not None:
        return header == list(TUM_COLUMNS)
    return not any(_names_other_columns(line) for _, line in found.comments)


def _names_other_columns(comment: str) -> bool:
    """Return whether a comment has eight words of which three or more are names of columns."""
    words = comment.split()
    return len(words) == 8 and sum(bool(set(plain([word])) & (NOT_HEIGHTS | HEIGHTS)) for word in words) >= 3
