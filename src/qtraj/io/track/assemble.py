"""Convert the table of a recording to a track."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.io.track.column_scales import scales
from qtraj.io.track.column_units import Unit, unit_of
from qtraj.io.track.given_times import given_times
from qtraj.io.track.kitti_poses import pose_axes, require_times
from qtraj.io.track.limit_columns import limit_samples
from qtraj.io.track.one_object import require_one_object
from qtraj.io.track.plausibility import oddities, rows_without_a_fix
from qtraj.io.track.race_line import race_line
from qtraj.io.track.reading import Reading, Recording
from qtraj.io.track.recorded_axes import choose_axes
from qtraj.io.track.recorded_times import Times
from qtraj.io.track.repeated_times import DifferentSamplesError, Merged, merge
from qtraj.io.track.segments import Segment, choose_segment
from qtraj.io.track.sources import Source
from qtraj.io.track.tangent_plane import TangentPlane
from qtraj.io.track.time_column import by_speeds, times_and_numbers
from qtraj.io.track.track_columns import Wanted, choose, has_geographic_position, unordered_attitude
from qtraj.io.track.track_facts import Columns, facts
from qtraj.io.track.track_parts import quantities
from qtraj.path.track import MIN_SAMPLES, Track


def assemble(source: Source, reading: Reading) -> Recording:
    """Return the track in a table, what it was read as, and what is odd in it."""
    path, table = source.name, source.table
    if source.kind == "kitti":
        require_times(path, reading.timed)
    source = _with_times(source, reading)
    plane = reading.plane
    if plane is None and _is_geographic(reading, table.header):
        plane = TangentPlane()
    columns = _columns(source, reading, plane is not None)
    if table.count < MIN_SAMPLES:
        raise ValueError(f"{path}: a track needs at least {MIN_SAMPLES} rows of numbers, but there are {table.count}")
    table.require_columns(path)
    require_one_object(path, table)
    used = [name for part, names in columns.chosen.items() if part != "time" for name in names]
    unit = columns.units["time"][0]
    if source.times is None:
        times, numbers = times_and_numbers(path, table, columns.chosen["time"], unit, used)
    else:
        times, numbers = source.times[1], table.numbers(path, used)
    if source.kind == "kitti":
        axes = pose_axes(path, numbers[:, :3], reading.axes)
        columns = columns._replace(axes=dict.fromkeys(columns.axes, axes))
    parts = quantities(path, columns, numbers, plane, reading.angles)
    if unit is None and source.times is None and "velocity" in parts:
        name = columns.chosen["time"][0]
        times = by_speeds(times, table, name, parts["position"], parts["velocity"], plane is not None)
    rows = choose_segment(path, table, columns.chosen["time"][0], times.seconds, source.breaks, reading.segment)
    merged = _merged(source, columns, rows, times, parts, reading)
    track = _track(path, merged)
    given = "" if source.times is None else source.times[0]
    origin = None if plane is None else _origin(columns, numbers[rows.start])
    unordered = None if track.attitudes is not None else unordered_attitude(table.header)
    notes = oddities(track, columns, origin, unordered)
    notes += () if plane is None else tuple(rows_without_a_fix(numbers[rows.start : rows.stop, :2]))
    line = None if source.line is None else source.line.part(slice(rows.start, rows.stop))
    limits = limit_samples(path, table, times.seconds, slice(rows.start, rows.stop), reading.limits)
    read = facts(columns, times, given, track, rows, (merged.note, *source.notes), line, origin, limits)
    return Recording(track, read, notes, line, limits)


def _is_geographic(reading: Reading, header: list[str]) -> bool:
    """Return whether positions are latitudes and longitudes by the column names, or by the user's columns and unit."""
    if "position" not in reading.columns:
        return has_geographic_position(header)
    unit = unit_of(reading.units.get("position", ""))
    return unit is not None and unit.kind == "angle"


def _origin(columns: Columns, row: np.ndarray) -> tuple[float, ...]:
    """Return the latitude and the longitude [°], and perhaps the height [m], in the first numbers of a row."""
    factors = [1.0 if unit is None else float(unit.factor) for unit in columns.units["position"]]
    return tuple(float(x) * factor for x, factor in zip(row, factors, strict=False))


def _with_times(source: Source, reading: Reading) -> Source:
    """Return the source with the times that the user gives, or that follow from distances and speeds."""
    times = given_times(source.name, source.table, reading.rate, reading.times)
    if times is not None:
        return source._replace(times=times)
    line = None if reading.columns else race_line(source.name, source.table, reading.units)
    if line is None:
        return source
    return source._replace(times=line.times, columns=line.columns, line=line.line)


def _columns(source: Source, reading: Reading, globe: bool) -> Columns:
    """Return the chosen columns, with their units and axes."""
    table = source.table
    first = table.row(0)
    own: dict[str, Any] = dict(source.columns) | dict(reading.columns)
    if source.times is not None:
        own["time"] = "time"
    header = table.header if source.times is None else ["time", *table.header]
    chosen = choose(source.name, header, Wanted(own, reading.angles, globe, reading.quaternion), first)
    rows = dict(zip(table.header, table.units or [], strict=False))
    angled = reading.angles is not None
    try:
        units: dict[str, list[Unit | None]] = {
            part: scales(part, names, reading.units, rows, globe, reading.angles) for part, names in chosen.items()
        }
        axes = choose_axes(chosen, reading.axes, globe)
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from error
    if reading.angles is not None and "rate" in axes:
        axes["rate"] = reading.angles.axes  # the axes of the gyro are those of the angles
    return Columns(table.header, chosen, units, axes, angled)


def _merged(
    source: Source, columns: Columns, rows: Segment, times: Times, parts: Mapping[str, np.ndarray], reading: Reading
) -> Merged:
    """Return one sample for each time of a segment."""
    inside = slice(rows.start, rows.stop)
    try:
        return merge(times.seconds[inside], {name: part[inside] for name, part in parts.items()}, reading.duplicates)
    except DifferentSamplesError as error:
        index = rows.start + error.index
        name = columns.chosen["time"][0]
        cells = [_cell(source, name, k) for k in (index, index - 1)]
        raise ValueError(
            f"{source.name}, {source.table.place(index)}: times must increase strictly, but in column {name!r} "
            f"{cells[0]} follows {cells[1]}, and the two rows differ. Pass duplicates='first', 'last' or 'mean' "
            "(in a scenario duplicates under [track], on the command line --duplicates)"
        ) from None


def _cell(source: Source, name: str, index: int) -> str:
    header = source.table.header
    return source.table.row(index)[header.index(name)].strip() if name in header else "a time"


def _track(path: Path | str, merged: Merged) -> Track:
    try:
        velocities, attitudes, rates = (merged.parts.get(part) for part in ("velocity", "attitude", "rate"))
        return Track(merged.times, merged.parts["position"], velocities, attitudes, rates)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
