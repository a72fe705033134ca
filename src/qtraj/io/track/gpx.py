"""Read GPX files with gpxpy: tracks and routes as columns of times, latitudes, longitudes and elevations."""

import re
from collections.abc import Sequence
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.extras import require_package
from qtraj.io.track.column_table import ColumnTable
from qtraj.path.track import MIN_SAMPLES

START = 4096
"""Number of bytes at the start of a file among which the root element is sought."""

_ENCODING = re.compile(rb"""<\?xml[^>]*encoding=["']([\w.-]+)["']""")
_ROOT = re.compile(rb"<(\w+:)?gpx[\s>]")


def is_gpx(data: bytes) -> bool:
    """Return whether the content of a file begins with the root element of GPX, after declarations and comments."""
    return b"<" in data[:8] and _ROOT.search(data[:START]) is not None


def read_gpx(
    path: Path, data: bytes, timed: bool, places: bool = False
) -> tuple[ColumnTable, list[int], tuple[str, ...]]:
    """Return the points of a file, the first points of further segments, and notes about what was left out.

    `timed`: whether the user gives the times of points without times. `places`: whether waypoints are read, too, if
    there are no tracks and routes.

    **Raises:** ValueError for a file without a recording: waypoints only, or no times. ModuleNotFoundError without
    gpxpy.
    """
    kind, parts = _parts(path, _parsed(path, data), places)
    points = [point for part in parts for point in part]
    with_time = [point for point in points if point.time is not None]
    notes = []
    if not with_time and not timed:
        raise ValueError(
            f"{path}: the {len(points)} points of the {kind} have no times, so they are a shape and not a recording. "
            "Read them with qtraj.read_shape, on the command line with qtraj retime. Pass rate= (samples per "
            "second) or times= (a file with one time on a line), in a scenario rate or times under "
            "[track], on the command line --rate or --times"
        )
    keep_times = len(with_time) == len(points) or not timed
    if keep_times and len(with_time) < len(points):
        left = f"{len(points) - len(with_time)} of {len(points)} points without times left out"
        notes.append(f"{left}; qtraj.read_shape reads all of them")
        _require_enough(path, len(with_time), len(points))
        parts = [[point for point in part if point.time is not None] for part in parts]
        points = with_time
    bounds = np.cumsum([len(part) for part in parts if part])[:-1].tolist()
    columns = {"time": _times(points)} if keep_times else {}
    heights, note = _heights([point.elevation for point in points], columns.get("time"))
    columns |= {
        "latitude": np.array([point.latitude for point in points], float),
        "longitude": np.array([point.longitude for point in points], float),
    }
    columns |= {} if heights is None else {"elevation": heights}
    return ColumnTable(columns, "point"), bounds, (*notes, *([note] if note else []))


def has_times(data: bytes) -> bool:
    """Return whether a point of a track, otherwise of a route, otherwise a waypoint has a time; nothing is parsed."""
    for name in (b"trkpt", b"rtept", b"wpt"):
        if first := re.search(rb"<(\w+:)?" + name + rb"\b", data):
            return re.search(rb"<(\w+:)?time\b", data[first.end() :]) is not None
    return True


def _parsed(path: Path, data: bytes) -> Any:
    require_package("gpxpy", f"{path}: reading GPX files", "exchange")
    import gpxpy
    import gpxpy.gpx

    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError(f"{path}: a GPX file must not have a document type or entities: remove these lines")
    declared = _ENCODING.search(data[:START])
    encoding = declared[1].decode() if declared and not data.startswith(b"\xef\xbb\xbf") else "utf-8-sig"
    try:
        text = data.decode(encoding)
        return gpxpy.parse(re.sub(r"^\s*<\?xml[^>]*\?>", "", text.lstrip("\ufeff")))
    except (gpxpy.gpx.GPXException, ValueError, TypeError, LookupError, OverflowError) as error:
        text = " ".join(str(error).removeprefix("Error parsing XML: ").split())
        raise ValueError(f"{path}: the GPX file cannot be read ({text}): correct or export it again") from None


def _parts(path: Path, gpx: Any, places: bool) -> tuple[str, list[list[Any]]]:
    """Return the segments of the tracks or, without tracks, the routes or, with `places`, the waypoints."""
    segments = [segment.points for track in gpx.tracks for segment in track.segments if segment.points]
    if segments:
        return "tracks", segments
    routes = [route.points for route in gpx.routes if route.points]
    if routes:
        return "routes", routes
    if gpx.waypoints and places:
        return "waypoints", [gpx.waypoints]
    if gpx.waypoints:
        raise ValueError(
            f"{path}: the GPX file contains only {len(gpx.waypoints)} waypoints (wpt), which are places and not a "
            "recording: read them as a shape with qtraj.read_shape, export the track (trk), or write the waypoints in "
            "their order with times to a CSV file"
        )
    raise ValueError(f"{path}: the GPX file contains no points: export a file with a track (trk)")


def _require_enough(path: Path, timed: int, count: int) -> None:
    if timed < MIN_SAMPLES:
        raise ValueError(
            f"{path}: only {timed} of {count} points have times, but a track needs at least {MIN_SAMPLES}. If the "
            "samples are equally spaced in time, pass rate= (samples per second)"
        )


def _times(points: Sequence[Any]) -> np.ndarray:
    naive = [t.astimezone(UTC).replace(tzinfo=None) if t.tzinfo else t for t in (point.time for point in points)]
    return np.array(naive, "M8[us]")


def _heights(elevations: list[float | None], times: np.ndarray | None) -> tuple[np.ndarray | None, str]:
    """Return the elevations, or None if most are missing, and a note.

    Single missing ones are interpolated over time, or over the points if there are no times or the clock jumps back.
    """
    known = np.array([value is not None for value in elevations])
    if not known.any():
        return None, "no elevations"
    if 2 * known.sum() < len(known):
        return None, f"height 0, because only {known.sum()} of {len(known)} points have elevations"
    values = np.array([0.0 if value is None else value for value in elevations])
    if not values.any():
        return values, "all elevations are 0"
    if known.all():
        return values, ""
    seconds = np.arange(len(known)) if times is None else times.astype(np.int64)
    places = seconds if (np.diff(seconds) >= 0).all() else np.arange(len(known))
    heights = np.interp(places, places[known], values[known])
    return heights, f"{(~known).sum()} missing elevations interpolated"
