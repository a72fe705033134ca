"""Read recorded tracks from text files: CSV with a header row, and TUM trajectories."""

from __future__ import annotations  # so that `help` shows short names

import csv
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from qtraj.algebra import hamilton, rotation
from qtraj.foundation.arrays import as_float
from qtraj.foundation.untrusted import read_text
from qtraj.io.attitude_angles import AttitudeAngles
from qtraj.io.tangent_plane import TangentPlane
from qtraj.io.track_columns import choose
from qtraj.path.track import MIN_SAMPLES, Track

TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
TUM_SCALAR_FIRST = [7, 4, 5, 6]

Lines = list[tuple[int, str]]


def read_track(
    file: str | os.PathLike[str],
    columns: Mapping[str, str | Sequence[str] | None] | None = None,
    angles: AttitudeAngles | None = None,
    projection: TangentPlane | str | None = None,
) -> Track:
    """Read a recorded track from a text file, with velocities, attitudes and rates if the file contains them.

    A CSV file (commas, semicolons or tabs; UTF-8; lines that start with # are comments) has a header row. `columns`
    names its columns, for example {"time": "t", "position": ["e", "n", "u"], "velocity": [...], "attitude": [...]}. The
    attitude is a quaternion, body to world, scalar first. "rate" names three angular rates, or only the yaw rate. A
    quantity whose entry is None is omitted. Quantities that `columns` does not contain are recognised by common names
    (time, t; x, y, z; easting, northing, altitude; vx, vy, vz; vel_east, vel_north, vel_up; qw, qx, qy, qz; angvel_x,
    angvel_y, angvel_z; wx, wy, wz, and similar names), if all columns of the quantity have common names. A rate about z
    without the other two rates is read as the yaw rate.

    A TUM trajectory (eight numbers "timestamp tx ty tz qx qy qz qw" on a line, no header) is recognised by its content.
    The quaternions of a TUM trajectory, scalar last, are reordered. Files whose names end with .gz are decompressed.
    The units are the units of `Track`: s, m, m/s, rad/s.

    If `angles` is an `AttitudeAngles`, the attitude is read from the three columns roll, pitch and heading in this
    convention. If `projection` is "tangent-plane" or a `TangentPlane`, the position is read from latitude [°],
    longitude [°] and height above the ellipsoid [m], and converted to metres east, north and up. Velocities and
    attitudes then refer to the axes east, north and up at each sample, and are rotated accordingly.

    **Raises:** FileNotFoundError for a missing file; ValueError with file, line, column and value for a cell that is
    missing or not a finite number, times that do not increase strictly, unknown columns, or too few rows; ValueError
    with the options for angles without `angles` and for latitudes without `projection`.
    """
    path = Path(file)
    plane = _plane(projection)
    if angles is not None and not isinstance(angles, AttitudeAngles):
        raise ValueError(f"angles= must be a qtraj.AttitudeAngles, but {angles!r} was given")
    lines = _content(path)
    if _is_tum(path, lines):
        if columns is not None or angles is not None or plane is not None:
            raise ValueError(
                f"{path}: columns=, angles= and projection= are for CSV files, but this is a TUM trajectory, which has "
                "positions in metres, quaternions and no header row"
            )
        return _read_tum(path, lines)
    try:
        return _read_csv(path, lines, columns, angles, plane)
    except csv.Error as error:
        raise ValueError(f"{path}: the table cannot be read ({error})") from error


def _content(path: Path) -> Lines:
    """Return the lines of a file with their line numbers, without comments and blank lines."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: there is no such file, so no track can be read") from None
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise ValueError(f"{path}: the file is empty, but a track needs rows of times and positions")
    return lines


def _is_tum(path: Path, lines: Lines) -> bool:
    cells = lines[0][1].split()
    numbers = all(_is_number(cell) for cell in cells)
    return numbers and (len(cells) == len(TUM_COLUMNS) or path.suffix.lower() in {".txt", ".tum"})


def _read_tum(path: Path, lines: Lines) -> Track:
    table = _numbers(path, lines, _split, range(len(TUM_COLUMNS)), TUM_COLUMNS)
    _require_increasing(path, lines, table[:, 0], TUM_COLUMNS[0])
    return _track(path, table[:, 0], table[:, 1:4], None, table[:, TUM_SCALAR_FIRST])


def _plane(projection: TangentPlane | str | None) -> TangentPlane | None:
    if projection is None or isinstance(projection, TangentPlane):
        return projection
    if projection != "tangent-plane":
        raise ValueError(f"projection= must be 'tangent-plane' or a qtraj.TangentPlane, but {projection!r} was given")
    return TangentPlane()


def _read_csv(
    path: Path,
    lines: Lines,
    columns: Mapping[str, str | Sequence[str] | None] | None,
    angles: AttitudeAngles | None,
    plane: TangentPlane | None,
) -> Track:
    line, names = lines[0]
    delimiter = max(",;\t", key=names.count)

    def parse(lines: Lines) -> Iterator[list[str]]:
        return csv.reader((line for _, line in lines), delimiter=delimiter, skipinitialspace=True)

    header = [cell.strip() for cell in next(parse(lines))]
    if all(_is_number(cell) for cell in header):
        raise ValueError(f"{path}, line {line}: expected a header row with column names, but the row contains numbers")
    chosen = choose(path, header, {} if columns is None else columns, angles, plane is not None)
    used = [name for part in chosen.values() for name in part]
    table = _numbers(path, lines[1:], parse, [header.index(name) for name in used], used)
    _require_increasing(path, lines[1:], table[:, 0], used[0])
    ends = np.cumsum([len(part) for part in chosen.values()])[:-1]
    parts = dict(zip(chosen, np.split(table, ends, axis=1), strict=True))
    position, velocity, attitude = parts["position"], parts.get("velocity"), parts.get("attitude")
    if attitude is not None and angles is not None:
        attitude = angles.quaternions(attitude)
    if plane is not None:
        position, velocity, attitude = _projected(path, plane, position, velocity, attitude)
    return _track(path, table[:, 0], position, velocity, attitude, parts.get("rate"))


def _projected(
    path: Path, plane: TangentPlane, geodetic: np.ndarray, velocity: np.ndarray | None, attitude: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Return positions in the tangent plane, and velocities and attitudes rotated to its axes.

    The recorded velocities and attitudes refer to the local axes of each sample.
    """
    try:
        position, rotations = plane.project(geodetic)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if velocity is not None:
        velocity = np.einsum("nij,nj->ni", rotations, velocity)
    if attitude is not None:
        local = np.asarray(jax.vmap(rotation.from_dcm)(as_float(np.swapaxes(rotations, -1, -2))), float)
        attitude = np.stack(hamilton.product(tuple(local.T), tuple(attitude.T)), axis=1)  # pyright: ignore[reportArgumentType]
    return position, velocity, attitude


def _split(lines: Lines) -> Iterator[list[str]]:
    return (line.split() for _, line in lines)


def _numbers(
    path: Path, lines: Lines, parse: Callable[[Lines], Iterator[list[str]]], places: Sequence[int], names: Sequence[str]
) -> np.ndarray:
    """Return the selected cells (rows, columns) in float64; raise a ValueError if a cell is not a finite number."""
    if len(lines) < MIN_SAMPLES:
        raise ValueError(f"{path}: a track needs at least {MIN_SAMPLES} rows of numbers, but there are {len(lines)}")
    try:
        table = np.array([[float(row[k]) for k in places] for row in parse(lines)])
    except (ValueError, IndexError, csv.Error):
        table = np.full((1, 1), np.nan)
    if len(table) != len(lines) or not np.isfinite(table).all():
        for number, line in lines:
            row = next(parse([(number, line)]))
            for k, name in zip(places, names, strict=True):
                _require_number(path, number, name, row[k].strip() if k < len(row) else "")
        raise ValueError(f"{path}: a quoted cell spans several lines, but each row must be on one line")
    return table


def _require_number(path: Path, line: int, name: str, cell: str) -> None:
    if not cell:
        raise ValueError(f"{path}, line {line}: the cell of column {name!r} is missing")
    if not _is_number(cell) or not np.isfinite(float(cell)):
        raise ValueError(f"{path}, line {line}: column {name!r} must have finite numbers, but contains {cell!r}")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _require_increasing(path: Path, lines: Lines, times: np.ndarray, name: str) -> None:
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        k = int(late[0]) + 1
        raise ValueError(
            f"{path}, line {lines[k][0]}: times must increase strictly, but in column {name!r} "
            f"{times[k]:.17g} follows {times[k - 1]:.17g}"
        )


def _track(
    path: Path,
    time: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray | None,
    attitude: np.ndarray | None,
    rate: np.ndarray | None = None,
) -> Track:
    try:
        return Track(time, position, velocity, attitude, rate)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
