"""Read recorded tracks: from text files, GPX and NMEA files, and tables of pandas, polars and xarray."""

from __future__ import annotations  # so that `help` shows short names

import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from qtraj.io.track.assemble import assemble
from qtraj.io.track.attitude_angles import AttitudeAngles
from qtraj.io.track.reading import Recording, checked
from qtraj.io.track.sources import find_source
from qtraj.io.track.tangent_plane import TangentPlane
from qtraj.path.track import Track


def read_track(
    file: str | os.PathLike[str] | Any,
    columns: Mapping[str, str | Sequence[str] | None] | None = None,
    angles: AttitudeAngles | None = None,
    projection: TangentPlane | str | None = None,
    units: Mapping[str, str] | None = None,
    axes: str | None = None,
    rate: float | None = None,
    times: str | os.PathLike[str] | None = None,
    duplicates: str | None = None,
    quaternion: str | None = None,
    segment: int | None = None,
) -> Track:
    """Read a recorded track from a file or a table, with velocities, attitudes and rates if it contains them.

    The content of the file determines how it is read, and not its name: a table with commas, semicolons, tabs or
    spaces, with decimal points or commas, in UTF-8; a TUM trajectory (eight numbers "timestamp tx ty tz qx qy qz qw" on
    a line, no header); KITTI poses (twelve numbers on a line, no times); a GPX file; or sentences of an NMEA receiver.
    Lines that start with #, % or // are comments. The header is the first line that names columns; it may follow other
    lines, or be a comment. Files whose names end with .gz are decompressed.

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
        file: The name of the file, or a data frame of pandas or polars, or a dataset of xarray.
        columns: The columns of quantities with other names, for example {"time": "t", "position": ["e", "n", "u"],
            "velocity": [...], "attitude": [...]}. The attitude is a quaternion, body to world, scalar first. "rate"
            names three angular rates, or only the yaw rate. A quantity whose entry is None is omitted. The columns of a
            table without header are named "1", "2", "3", ….
        angles: The convention of an attitude in the three columns roll, pitch and heading.
        projection: "tangent-plane" or a `TangentPlane`, if the position is latitude, longitude and height.
        units: The units of "time", "position", "velocity" and "rate", for example {"velocity": "km/h"}; default: the
            units in the column names, otherwise s, m, m/s, rad/s. With "deg" or "rad" for the position, `columns` names
            latitude, longitude and height.
        axes: The world axes of position, velocity and attitude: "enu" (z is up), "ned" (north, east, down; body axes
            forward, right, down) or "camera" (right, down, forward; for the body axes, too). The track has z up and
            body axes forward, left, up. Default: by the column names, otherwise "enu"; for KITTI poses "camera".
        rate: The number of samples per second of a file without times.
        times: The name of a file with one time [s] on each line, for a file without times.
        duplicates: "first", "last" or "mean" of the rows at one time. By default, equal rows count once, and rows whose
            positions differ by less than a step to a neighbour are averaged.
        quaternion: "wxyz" (scalar first) or "xyzw" (scalar last): the order of a quaternion whose column names, such as
            q0, q1, q2, q3, do not tell it, or that `columns` names. Without it, such columns are left out, and the
            columns in `columns` have the scalar first.
        segment: The number of a segment, from 1. A segment begins where the clock jumps back, and at each segment of a
            GPX file. By default, all segments are read, if the times increase from one to the next.

    Returns:
        The track. A UserWarning states what is odd in it, such as velocities that are 3.6 times as large as those of
        the positions, and what to pass instead.

    Raises:
        FileNotFoundError: For a missing file.
        ModuleNotFoundError: For a GPX or NMEA file without gpxpy or pynmeagps (`pip install 'qtraj[exchange]'`).
        ValueError: With file, line, column and value for a cell that is missing or not a finite number, times that do
            not increase strictly, unknown columns, or too few rows; with the options for columns that are not
            recognised, units that do not fit, and angles without `angles`.
    """
    recording = read_recording(
        file,
        columns=columns,
        angles=angles,
        projection=projection,
        units=units,
        axes=axes,
        rate=rate,
        times=times,
        duplicates=duplicates,
        quaternion=quaternion,
        segment=segment,
    )
    for note in recording.notes:
        warnings.warn(note, stacklevel=2)
    return recording.track


def read_recording(file: str | os.PathLike[str] | Any, **options: Any) -> Recording:
    """Read a track as `read_track` does, and state in four lines what was read as what, and what is odd in it.

    `options`: those of `read_track`.
    """
    reading = checked(**options)
    return assemble(find_source(file, reading), reading)
