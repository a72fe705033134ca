"""Recognise recordings by their file names or contents."""

import re
from pathlib import Path

from qtraj.io.track.column_names import names_columns
from qtraj.io.track.delimited import DELIMITERS, is_number, names_of, row_delimiter
from qtraj.io.track.gpx import is_gpx
from qtraj.io.track.lines import COMMENTS, UTF16
from qtraj.io.track.nmea import is_nmea
from qtraj.io.track.recorded_times import is_time

RECORDINGS = (".csv", ".tsv", ".tum", ".gpx", ".nmea")
"""Suffixes of recordings; files with other suffixes, such as .txt, are recognised by their contents."""
MIN_COLUMNS = 4
"""Minimum number of columns of a recording: time and three coordinates, or time and place without a height."""
HEADER_LINES = 10
_NOT_NAMES = re.compile(r"=|^\s*\[|\{")


def is_recording(file: Path, start: bytes = b"") -> bool:
    """Return whether the suffix of a file, or its `start`, indicates a recording.

    Its start does if it is GPX or NMEA, if a line names the columns of a time and a position, or if it has a row of
    numbers, which may follow up to `HEADER_LINES` lines of names.
    """
    plain = file.with_suffix("") if file.suffix == ".gz" else file
    if plain.suffix.lower() in RECORDINGS or is_gpx(start) or is_nmea(start):
        return True
    text = start.decode("utf-16" if start.startswith(UTF16) else "utf-8-sig", errors="replace")
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(COMMENTS)]
    names = next((k for k, line in enumerate(lines[: HEADER_LINES + 1]) if _is_header(line)), None)
    if names is not None and not any(_NOT_NAMES.search(line) for line in lines[:names]):
        return True
    first = next((k for k, line in enumerate(lines[: HEADER_LINES + 1]) if _is_row(line)), None)
    return first is not None and not any(_NOT_NAMES.search(line) for line in lines[:first])


def _is_header(line: str) -> bool:
    """Return whether a line names the columns of a time and a position; in TOML, such a line has an equals sign."""
    return not _NOT_NAMES.search(line) and any(names_columns(names_of(line, delimiter)) for delimiter in DELIMITERS)


def _is_row(line: str) -> bool:
    """Return whether most cells of a line are numbers, and the first one is a number, a time or a short name."""
    if _NOT_NAMES.search(line):
        return False
    delimiter = row_delimiter(line)
    cells = names_of(line, delimiter)
    numbers = sum(is_number(cell, delimiter != ",") for cell in cells)
    timed = any(map(is_time, cells[:3]))
    return numbers + timed >= MIN_COLUMNS - 1 and len(cells) >= MIN_COLUMNS - timed and cells[0] != ""
