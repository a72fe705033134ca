"""Find out whether an input file is a curve without times, and not a recording."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from qtraj.foundation.untrusted import read_bytes
from qtraj.io.shape.geojson import is_geojson
from qtraj.io.shape.headerless import columns_by_number, text_of
from qtraj.io.shape.shape_columns import COUNTS, SPATIAL
from qtraj.io.track.column_names import find
from qtraj.io.track.delimited import content, find_table
from qtraj.io.track.gpx import has_times, is_gpx
from qtraj.io.track.known_names import FLAT, GLOBAL
from qtraj.io.track.nmea import is_nmea
from qtraj.io.track.race_line import race_line
from qtraj.io.track.reading import Reading, checked
from qtraj.io.track.recording import is_recording
from qtraj.io.track.track_columns import names_times

START = 2**16
"""Number of bytes at the start of a file by which it is recognised, because a recording may be long."""


def is_untimed(file: Path, options: Mapping[str, Any]) -> bool:
    """Return whether a file is a curve without times; `options` are the user's options of a recording.

    A file that is damaged or not understood is not one: the reader of recordings then reports what is wrong.

    **Raises:** OSError if the file cannot be read.
    """
    columns = dict(options.get("columns", {}))
    if "rate" in options or "times" in options or "time" in columns:
        return False
    try:
        data = read_bytes(file)
        if is_geojson(data):
            return True
        if is_gpx(data):
            return not has_times(data)
        start = data if len(data) <= START else data[: data.rindex(b"\n", 0, START)]
        if is_nmea(start) or not set(columns) <= set(COUNTS):
            return False
        if not columns and columns_by_number(file, start) is not None:
            return True
        return is_recording(file, start) and _has_no_times(file, start, checked(columns=columns))
    except ValueError:
        return False


def _has_no_times(file: Path, start: bytes, reading: Reading) -> bool:
    """Return whether a table has a position, but no times, and no distances and speeds from which they follow.

    `start` is the start of the file.
    """
    table = find_table(file, content(file, text_of(start)), reading.named)
    if names_times(table.header, table.row(0)):
        return False
    if find((*SPATIAL, *FLAT, *GLOBAL), table.header) is None and "position" not in reading.columns:
        return False
    return race_line(file, table, {}) is None
