"""Read shapes, curves without times, from tables of points, GeoJSON and GPX files."""

from __future__ import annotations  # so that `help` shows short names

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from qtraj.foundation.size_text import length_text
from qtraj.foundation.untrusted import read_bytes
from qtraj.io.shape.geojson import is_geojson, read_geojson
from qtraj.io.shape.headerless import columns_by_number
from qtraj.io.shape.shape_columns import choose
from qtraj.io.track.column_scales import scales
from qtraj.io.track.column_units import unit_of
from qtraj.io.track.gpx import is_gpx, read_gpx
from qtraj.io.track.reading import Reading, checked
from qtraj.io.track.recorded_axes import choose_axes
from qtraj.io.track.sources import Source, find_source
from qtraj.io.track.tangent_plane import TangentPlane
from qtraj.io.track.track_columns import has_geographic_position
from qtraj.io.track.track_facts import Columns
from qtraj.io.track.track_parts import parts_of, projected
from qtraj.path.shape import Shape


class ShapeRead(NamedTuple):
    """A shape, lines of text that state what was read as what, and texts about what is odd in it."""

    shape: Shape
    facts: tuple[str, ...]
    notes: tuple[str, ...] = ()


def read_shape(
    file: str | os.PathLike[str] | Any,
    columns: Mapping[str, str | Sequence[str] | None] | None = None,
    projection: TangentPlane | str | None = None,
    units: Mapping[str, str] | None = None,
    axes: str | None = None,
    segment: int | None = None,
    closed: bool | None = None,
    tolerance: float | None = None,
) -> Shape:
    """Read a curve without times from a file: a centre line with widths, waypoints, or a road of a map.

    The content of the file determines how it is read: a table of points, as for `read_track`, such as a race track of
    the TU Munich with the header `# x_m,y_m,w_tr_right_m,w_tr_left_m`; a LineString of a GeoJSON file; the track, the
    route or the waypoints of a GPX file. Times are ignored. A table of two or three columns of numbers needs no header.
    Latitude, longitude and height are projected to a tangent plane, as in `read_track`.

    Args:
        file: The name of the file, or a data frame of pandas or polars, or a dataset of xarray.
        columns: The columns of "position" (two or three) and of "widths" (to the right and to the left edge), if they
            have other names.
        projection: "tangent-plane" or a `TangentPlane`, if the position is latitude, longitude and height.
        units: The unit of "position", for example {"position": "cm"}; default: the units in the column names,
            otherwise m. Widths have the units in their column names, otherwise m.
        axes: The axes of the position: "enu" (default, z is up), "ned" or "camera".
        segment: The number of a line, from 1, in a file with several lines.
        closed: Whether the last point is followed by the first one; by default recognised, see `Shape.through`.
        tolerance: [m], the RMS distance of the points from the curve; by default, the curve passes through them.

    Returns:
        The shape. A UserWarning states what is odd in it, such as repeated points.

    Raises:
        FileNotFoundError: For a missing file.
        ModuleNotFoundError: For a GPX file without gpxpy (`pip install 'qtraj[exchange]'`).
        ValueError: With file, line and column for a cell that is missing or not a finite number; for columns that are
            not recognised, and a file with several lines without `segment`; otherwise as `Shape.through`.
    """
    found = read_line(
        file,
        closed=closed,
        tolerance=tolerance,
        columns=columns,
        projection=projection,
        units=units,
        axes=axes,
        segment=segment,
    )
    for note in found.notes:
        warnings.warn(note, stacklevel=2)
    return found.shape


def read_line(file: Any, closed: bool | None = None, tolerance: float | None = None, **options: Any) -> ShapeRead:
    """Read a shape as `read_shape` does, and state what was read as what, and what is odd in it."""
    reading = checked(**options)
    source = _source(file, reading)
    chosen, positions, widths = _columns(source, reading)
    rows = _rows(source, reading.segment)
    widths = None if widths is None else widths[rows]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            shape = Shape.through(positions[rows], closed, tolerance, widths)
        except ValueError as error:
            raise ValueError(f"{source.name}: {error}") from error
    facts = _facts(source, chosen, shape, len(positions[rows]))
    return ShapeRead(shape, facts, tuple(str(x.message) for x in caught))


def _source(file: Any, reading: Reading) -> Source:
    """Return the table of points in a file, or of another library."""
    if isinstance(file, str | os.PathLike) and os.fspath(file):
        path = Path(file)
        try:
            data = read_bytes(path)
        except FileNotFoundError:
            raise FileNotFoundError(f"{path}: there is no such file, so no shape can be read") from None
        if is_geojson(data):
            table, breaks, notes = read_geojson(path, data)
            return Source(path, table, kind="geojson", breaks=breaks, notes=notes)
        if is_gpx(data):
            table, breaks, notes = read_gpx(path, data, timed=True, places=True)
            return Source(path, table, kind="gpx", breaks=breaks, notes=notes)
        if not reading.columns and (numbered := columns_by_number(path, data)):
            reading = reading._replace(columns={"position": numbered})
            return find_source(file, reading)._replace(columns={"position": numbered})
    return find_source(file, reading)


def _columns(source: Source, reading: Reading) -> tuple[dict[str, tuple[str, ...]], np.ndarray, np.ndarray | None]:
    """Return the chosen columns, positions (n, 3) [m] and widths (n, 2) [m], or None."""
    path, table = source.name, source.table
    unit = unit_of(reading.units.get("position", ""))
    angular = unit is not None and unit.kind == "angle"
    unnamed = "position" not in reading.columns and has_geographic_position(table.header)
    plane = reading.plane or (TangentPlane() if angular or unnamed else None)
    globe, own = plane is not None, source.columns.get("position")
    chosen = choose(path, table.header, table.row(0), reading.columns, own, globe)
    table.require_columns(path)
    rows = dict(zip(table.header, table.units or [], strict=False))
    names = chosen["position"]
    try:
        unit_of_each = scales("position", names, reading.units, rows, globe, None)
        axes = choose_axes({"position": names}, reading.axes, globe)
        of_widths = [scales("position", [name], {}, rows, False, None)[0] for name in chosen.get("widths", ())]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    columns = Columns(table.header, {"position": names}, {"position": unit_of_each}, axes)
    positions = parts_of(columns, table.numbers(path, names))["position"]
    if plane is not None:
        positions = projected(path, plane, positions, None, None)["position"]
    if not of_widths:
        return chosen, positions, None
    factors = [1.0 if unit is None else float(unit.factor) for unit in of_widths]
    return chosen, positions, table.numbers(path, chosen["widths"]) * factors


def _rows(source: Source, segment: int | None) -> slice:
    """Return the rows of one line.

    **Raises:** ValueError for a file with several lines without `segment`, or a segment that does not exist.
    """
    edges = [0, *source.breaks, source.table.count]
    count = len(edges) - 1
    if segment is None and count > 1:
        raise ValueError(
            f"{source.name}: the file contains {count} lines, but a shape is one curve: pass segment= (1 to {count}), "
            "on the command line --segment"
        )
    if (segment or 1) > count:
        raise ValueError(f"{source.name}: segment={segment} was given, but the file contains {count} line(s)")
    at = (segment or 1) - 1
    return slice(edges[at], edges[at + 1])


def _facts(source: Source, chosen: Mapping[str, tuple[str, ...]], shape: Shape, count: int) -> tuple[str, ...]:
    """Return three lines of text: the position, the widths, and the curve with the columns that were left out."""
    used = {name for names in chosen.values() for name in names}
    left = [name for name in source.table.header if name not in used]
    kind = "closed" if shape.closed else "open"
    omitted = f"left out: {', '.join(left[:8])}{', …' if len(left) > 8 else ''}" if left else ""
    more = "".join(f"; {text}" for text in (omitted, *source.notes) if text)
    widths = (
        f"widths: {', '.join(chosen['widths'])}, to the right and to the left" if "widths" in chosen else "no widths"
    )
    return (
        f"position: {', '.join(chosen['position'])}{'' if len(chosen['position']) == 3 else ', height 0 m'}",
        widths,
        f"{kind} curve of {length_text(float(shape.length))} through {count} points, without times{more}",
    )
