"""Read recorded tracks from text files: tables with column names, and TUM trajectories."""

from __future__ import annotations  # so that `help` shows short names

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qtraj.io.attitude_angles import AttitudeAngles
from qtraj.io.column_scales import Units, require_units, scales
from qtraj.io.column_units import Unit
from qtraj.io.delimited import Content, Table, are_numbers, content, find_table, header_in_comment, is_number
from qtraj.io.given_times import described, require_rate, with_times
from qtraj.io.kitti_poses import (
    COLUMNS as KITTI_COLUMNS,
    POSITION,
    ROTATION,
    attitudes,
    is_kitti,
    pose_axes,
    require_times,
)
from qtraj.io.recorded_axes import attitudes_up, choose_axes, rates_up, vectors_up
from qtraj.io.recorded_times import Times, by_speeds
from qtraj.io.repeated_times import CHOICES, DifferentSamplesError, merge
from qtraj.io.table_cells import read_cells, same_time
from qtraj.io.tangent_plane import TangentPlane
from qtraj.io.track_columns import choose, has_geographic_position
from qtraj.io.track_facts import Columns, facts
from qtraj.io.track_parts import parts_of, projected
from qtraj.path.track import Track

TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


class Recording(NamedTuple):
    """A track, and four lines of text that state what was read from its file and as what."""

    track: Track
    facts: tuple[str, str, str, str]


class Reading(NamedTuple):
    """The options of `read_track`, checked."""

    columns: Mapping[str, str | Sequence[str] | None]
    angles: AttitudeAngles | None
    plane: TangentPlane | None
    units: Units
    axes: str | None
    duplicates: str | None
    given_times: str = ""


def read_track(
    file: str | os.PathLike[str],
    columns: Mapping[str, str | Sequence[str] | None] | None = None,
    angles: AttitudeAngles | None = None,
    projection: TangentPlane | str | None = None,
    units: Mapping[str, str] | None = None,
    axes: str | None = None,
    rate: float | None = None,
    times: str | os.PathLike[str] | None = None,
    duplicates: str | None = None,
) -> Track:
    """Read a recorded track from a text file, with velocities, attitudes and rates if the file contains them.

    The content of the file determines how it is read, and not its name: a table with commas, semicolons, tabs or
    spaces, with decimal points or commas, in UTF-8; a TUM trajectory (eight numbers "timestamp tx ty tz qx qy qz qw" on
    a line, no header); or KITTI poses (twelve numbers on a line, no times). Lines that start with #, % or // are
    comments. The header is the first line that names columns; it may follow other lines, or be a comment. Files whose
    names end with .gz are decompressed.

    Quantities are recognised by common names (time, t, timestamp; x, y, z; easting, northing, altitude; north, east,
    down; latitude, longitude, altitude; vx, vy, vz; vel_east, vel_north, vel_up; qw, qx, qy, qz; wx, wy, wz, and
    similar names), if all columns of the quantity have common names. Case, underscores and units at the end of a name,
    as in `x [cm]`, `x (cm)` and `x_cm`, do not matter. The units are converted to the units of `Track`: s, m, m/s,
    rad/s. A rate about z without the other two rates is read as the yaw rate.

    Times are numbers, ISO 8601, or dates with the day first. The first time is subtracted from dates, and from Unix
    times in ms, µs and ns, before they are rounded to floating-point numbers. Other times keep their clock.

    Latitude [°], longitude [°] and height above the ellipsoid [m] are converted to metres east, north and up relative
    to the first sample, or to the origin of a `TangentPlane`. Without a height, the height is 0. Velocities and
    attitudes then refer to the axes at each sample, and are rotated accordingly.

    Args:
        file: The name of the file.
        columns: The columns of quantities with other names, for example {"time": "t", "position": ["e", "n", "u"],
            "velocity": [...], "attitude": [...]}. The attitude is a quaternion, body to world, scalar first. "rate"
            names three angular rates, or only the yaw rate. A quantity whose entry is None is omitted. The columns of a
            table without header are named "1", "2", "3", ….
        angles: The convention of an attitude in the three columns roll, pitch and heading.
        projection: "tangent-plane" or a `TangentPlane`, if the position is latitude, longitude and height.
        units: The units of "time", "position", "velocity" and "rate", for example {"velocity": "km/h"}; default: the
            units in the column names, otherwise s, m, m/s, rad/s.
        axes: The world axes of position, velocity and attitude: "enu" (z is up), "ned" (north, east, down; body axes
            forward, right, down) or "camera" (right, down, forward; for the body axes, too). The track has z up and
            body axes forward, left, up. Default: by the column names, otherwise "enu"; for KITTI poses "camera".
        rate: The number of samples per second of a file without times.
        times: The name of a file with one time [s] on each line, for a file without times.
        duplicates: "first", "last" or "mean" of the rows at one time. By default, equal rows count once, and rows whose
            positions differ by less than a step to a neighbour are averaged.

    Returns:
        The track.

    Raises:
        FileNotFoundError: For a missing file.
        ValueError: With file, line, column and value for a cell that is missing or not a finite number, times that do
            not increase strictly, unknown columns, or too few rows; with the options for columns that are not
            recognised, units that do not fit, and angles without `angles`.
    """
    return read_recording(file, columns, angles, projection, units, axes, rate, times, duplicates).track


def read_recording(
    file: str | os.PathLike[str],
    columns: Mapping[str, str | Sequence[str] | None] | None = None,
    angles: AttitudeAngles | None = None,
    projection: TangentPlane | str | None = None,
    units: Mapping[str, str] | None = None,
    axes: str | None = None,
    rate: float | None = None,
    times: str | os.PathLike[str] | None = None,
    duplicates: str | None = None,
) -> Recording:
    """Read a track as `read_track` does, and state in four lines what was read as what."""
    path = Path(file)
    plane = _plane(projection)
    if angles is not None and not isinstance(angles, AttitudeAngles):
        raise ValueError(f"angles= must be a qtraj.AttitudeAngles, but {angles!r} was given")
    require_units(units or {})
    require_rate(rate, times)
    if duplicates not in (None, *CHOICES):
        raise ValueError(f"duplicates= must be 'first', 'last' or 'mean', but {duplicates!r} was given")
    found = content(path)
    reading = Reading(columns or {}, angles, plane, units or {}, axes, duplicates, described(rate, times))
    if columns is None and is_kitti(found):
        require_times(path, rate is not None or times is not None)
        poses = Table(KITTI_COLUMNS, found.lines, " ")
        return _read_kitti(path, with_times(path, poses, rate, times), reading)
    is_tum = _is_tum(path, found) and not are_numbers(_named(reading))
    if is_tum and (columns is not None or angles is not None or plane is not None):
        raise ValueError(
            f"{path}: columns=, angles= and projection= are for CSV files, but this is a TUM trajectory, which has "
            "positions in metres, quaternions and no header row"
        )
    try:
        table = Table(list(TUM_COLUMNS), found.lines, " ") if is_tum else find_table(path, found, _named(reading))
        return _read(path, with_times(path, table, rate, times), reading)
    except csv.Error as error:
        raise ValueError(f"{path}: the table cannot be read ({error})") from error


def _is_tum(path: Path, found: Content) -> bool:
    """Return whether the file is a TUM trajectory: numbers between spaces, and no header with other names."""
    cells = found.lines[0][1].split()
    if not all(map(is_number, cells)) or not (len(cells) == 8 or path.suffix.lower() == ".tum"):
        return False
    header = header_in_comment(found)
    return header is None or header == list(TUM_COLUMNS)


def _plane(projection: TangentPlane | str | None) -> TangentPlane | None:
    if projection is None or isinstance(projection, TangentPlane):
        return projection
    if projection != "tangent-plane":
        raise ValueError(f"projection= must be 'tangent-plane' or a qtraj.TangentPlane, but {projection!r} was given")
    return TangentPlane()


def _named(reading: Reading) -> list[str]:
    """Return the column names that the user gives."""
    entries = [[names] if isinstance(names, str) else names for names in reading.columns.values() if names]
    return [name for names in entries for name in names]


def _read(path: Path, table: Table, reading: Reading) -> Recording:
    plane, angles = reading.plane, reading.angles
    if plane is None and "position" not in reading.columns and has_geographic_position(table.header):
        plane = TangentPlane()
    first = next(table.rows(table.lines[:1]), [])
    chosen = choose(path, table.header, reading.columns, angles, plane is not None, first)
    columns = _columns(path, table, reading, chosen, plane is not None)
    used = [name for part in chosen.values() for name in part]
    times, numbers = read_cells(path, table, used, columns.units["time"][0])
    parts = parts_of(columns, numbers)
    if columns.units["time"][0] is None and "velocity" in parts:
        times = by_speeds(times, parts["position"], parts["velocity"], plane is not None)
    attitude = parts.get("attitude")
    if attitude is not None and angles is not None:
        parts["attitude"] = angles.quaternions(attitude)
    elif attitude is not None:
        parts["attitude"] = attitudes_up(attitude, columns.axes["attitude"])
    if plane is not None:
        parts |= projected(path, plane, parts["position"], parts.get("velocity"), parts.get("attitude"))
    if "rate" in parts:
        parts["rate"] = rates_up(parts["rate"], columns.axes["rate"])
    return _recording(path, table, columns, times, parts, reading)


def _read_kitti(path: Path, table: Table, reading: Reading) -> Recording:
    times, numbers = read_cells(path, table, ("time", *POSITION, *ROTATION), None)
    axes = pose_axes(path, numbers[:, :3], reading.axes)
    chosen = {"time": ("time",), "position": POSITION, "attitude": ROTATION}
    units: dict[str, list[Unit | None]] = {part: [None] * len(names) for part, names in chosen.items()}
    try:
        columns = Columns(table.header, chosen, units, choose_axes(chosen, axes, False))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    turned = attitudes_up(attitudes(path, numbers[:, 3:]), axes)
    parts = {"position": vectors_up(numbers[:, :3], axes), "attitude": turned}
    return _recording(path, table, columns, times, parts, reading)


def _recording(
    path: Path, table: Table, columns: Columns, times: Times, parts: dict[str, np.ndarray], reading: Reading
) -> Recording:
    """Return the track with one sample for each time."""
    try:
        merged = merge(times.seconds, parts, reading.duplicates)
    except DifferentSamplesError as error:
        raise ValueError(same_time(path, table, columns.chosen["time"][0], times, error.index)) from None
    try:
        others = [merged.parts.get(part) for part in ("velocity", "attitude", "rate")]
        track = Track(merged.times, merged.parts["position"], *others)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    note = ", ".join(filter(None, (times.note, merged.note)))
    return Recording(track, facts(columns, times._replace(note=note), reading.given_times))


def _columns(path: Path, table: Table, reading: Reading, chosen: Mapping[str, tuple[str, ...]], globe: bool) -> Columns:
    """Return the units and the axes of the chosen columns."""
    rows = dict(zip(table.header, table.units or [], strict=False))
    try:
        units = {
            part: scales(part, names, reading.units, rows, globe, reading.angles) for part, names in chosen.items()
        }
        axes = choose_axes(chosen, reading.axes, globe)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Columns(table.header, chosen, units, axes, reading.angles is not None)
