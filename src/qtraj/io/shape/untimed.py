"""Find out whether an input file is a curve without times, and not a recording."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from qtraj.foundation.untrusted import read_bytes
from qtraj.io.shape.geojson import is_geojson
from qtraj.io.shape.headerless import columns_by_number
from qtraj.io.shape.shape_columns import COUNTS, FLAT, SPATIAL
from qtraj.io.track.column_names import find
from qtraj.io.track.gpx import has_times, is_gpx
from qtraj.io.track.known_names import GLOBAL
from qtraj.io.track.nmea import is_nmea
from qtraj.io.track.race_line import race_line
from qtraj.io.track.reading import checked
from qtraj.io.track.recording import is_recording
from qtraj.io.track.sources import find_source
from qtraj.io.track.track_columns import names_times

START = 2**16
"""Number of bytes at the start of a file by which a recording is recognised."""


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
            return not has_times(file, data)
        if is_nmea(data[:START]) or not set(columns) <= set(COUNTS):
            return False
        if not columns and columns_by_number(file, data) is not None:
            return True
        return is_recording(file, data[:START]) and _has_no_times(file, columns)
    except ValueError:
        return False


def _has_no_times(file: Path, columns: Mapping[str, Any]) -> bool:
    """Return whether a table has a position, but no times, and no distances and speeds from which they follow."""
    source = find_source(file, checked(columns=columns))
    table = source.table
    if source.kind != "table" or names_times(table.header, table.row(0)):
        return False
    if find((*SPATIAL, *FLAT, *GLOBAL), table.header) is None and "position" not in columns:
        return False
    return race_line(file, table, {}) is None
