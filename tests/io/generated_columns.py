"""Columns of recordings in random forms: times, positions, velocities and attitudes of one drive."""

from typing import NamedTuple

import numpy as np
from tests.io import drive

UNIX = 1_778_058_000
LENGTHS = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "km": 0.001, "ft": 1 / 0.3048}
SPEEDS = {"m/s": 1.0, "km/h": 3.6, "kn": 3600 / 1852, "mph": 1 / 0.44704}
SUFFIX = {"m/s": "mps", "km/h": "kmh", "kn": "kn", "mph": "mph"}


class Column(NamedTuple):
    name: str
    cells: list
    unit: str = ""
    quantity: str = ""


def pick(rng, *choices):
    return choices[int(rng.integers(len(choices)))]


def numbers(values, digits):
    return [f"{x:.{digits}f}" for x in values]


def time_columns(rng):
    """Columns of the times in a random form."""
    s, form = (
        drive.SECONDS,
        pick(rng, "s", "s", "ms", "us", "ns", "unix", "unix_ms", "unix_ns", "iso", "date", "split", "am"),
    )
    name = pick(rng, "t", "time", "timestamp", "Time")
    if form == "s":
        return [Column(name, numbers(s + pick(rng, 0.0, 100.0), 3), pick(rng, "", "s"), "time")]
    if form in ("ms", "us", "ns"):
        factor = {"ms": 10**3, "us": 10**6, "ns": 10**9}[form]
        return [Column(name, [str(round(x * 10) * factor // 10) for x in s], form, "time")]
    if form.startswith("unix"):
        factor = {"unix": 1, "unix_ms": 10**3, "unix_ns": 10**9}[form]
        cells = [f"{UNIX + x:.1f}" if factor == 1 else str((UNIX * 10 + round(x * 10)) * factor // 10) for x in s]
        return [Column(name, cells, "", "time")]
    clocks = [drive.clock(x, "") for x in s]
    if form == "iso":
        end, middle = pick(rng, "", "Z", "+00:00"), pick(rng, "T", " ")
        return [Column(name, [f"2026-05-06{middle}{c}{end}" for c in clocks], "", "time")]
    if form == "date":
        return [
            Column(
                name, [f"06{pick(rng, '.', '/')}05{'.'}2026 {c}".replace("/05.", "/05/") for c in clocks], "", "time"
            )
        ]
    if form == "am":
        return [Column(name, [f"06/05/2026 {drive.clock(x, 'am')}" for x in s], "", "time")]
    return [Column("date", ["2026-05-06"] * len(s), "", "time"), Column("time", clocks, "", "time")]


def place_columns(rng):
    """Columns of positions and, perhaps, velocities; the options that they need, and their precision."""
    form = pick(rng, "xyz", "enu", "ned", "axes", "globe", "named")
    if form == "globe":
        names = pick(rng, ("lat", "lon", "alt"), ("Latitude", "Longitude", "Height"), ("latitude", "lng", "elevation"))
        values = drive.geodetic(drive.POSITIONS)
        return [Column(n, numbers(c, 9), "", "globe") for n, c in zip(names, values.T, strict=True)], {}, 5e-3
    unit, speed = pick(rng, *LENGTHS), pick(rng, *SPEEDS)
    down = form in ("ned", "axes")
    positions = LENGTHS[unit] * (drive.ned(drive.POSITIONS) if down else drive.POSITIONS)
    velocities = SPEEDS[speed] * (drive.ned(drive.VELOCITIES) if down else drive.VELOCITIES)
    names, fast = {
        "xyz": (pick(rng, ("x", "y", "z"), ("px", "py", "pz"), ("pos_x", "pos_y", "pos_z")), ("vx", "vy", "vz")),
        "enu": (pick(rng, ("east", "north", "up"), ("easting", "northing", "altitude")), ("ve", "vn", "vu")),
        "ned": (("north", "east", "down"), ("vn", "ve", "vd")),
        "axes": (("x", "y", "z"), ("vx", "vy", "vz")),
        "named": (("c1", "c2", "c3"), ("vx", "vy", "vz")),
    }[form]
    columns = [Column(n, numbers(c, 6), unit, "position") for n, c in zip(names, positions.T, strict=True)]
    if rng.random() < 0.5:
        columns += [Column(n, numbers(c, 6), speed, "velocity") for n, c in zip(fast, velocities.T, strict=True)]
    options = {"axes": {"axes": "ned"}, "named": {"columns": {"position": list(names)}}}.get(form, {})
    return columns, options, 5e-3 if unit in ("km",) else 2e-3


def attitude_columns(rng, down):
    """Columns of a quaternion or a matrix, and the options that they need."""
    rotations = drive.ROTATIONS
    matrices = drive.NED.T @ rotations.as_matrix() @ drive.FLU_TO_FRD if down else rotations.as_matrix()
    quaternions = type(rotations).from_matrix(matrices).as_quat(scalar_first=True)
    form = pick(rng, "named", "named", "indexed", "matrix")
    if form == "matrix":
        names = [f"{pick(rng, 'r', 'R_')}{i}{j}" for i in "123" for j in "123"]
        prefix = names[0][:-2]
        cells = matrices.reshape(-1, 9).T
        return [Column(prefix + n[-2:], numbers(c, 8), "", "a") for n, c in zip(names, cells, strict=True)], {}
    if form == "indexed":
        order = pick(rng, "wxyz", "xyzw")
        values = quaternions if order == "wxyz" else np.roll(quaternions, -1, axis=1)
        return [Column(f"q{k}", numbers(c, 8), "", "a") for k, c in enumerate(values.T)], {"quaternion": order}
    prefix = pick(rng, "q", "q_", "quat_", "orientation_")
    return [Column(prefix + n, numbers(c, 8), "", "a") for n, c in zip("wxyz", quaternions.T, strict=True)], {}


def with_units(rng, columns, style):
    """Names with their units, as `style` writes them; an option for quantities whose names do not contain the unit."""
    options, result = {}, []
    for column in columns:
        unit, name = column.unit, column.name
        if unit and style == "option":
            options[column.quantity] = unit
        elif unit and style in ("[", "("):
            name = f"{name}{pick(rng, '', ' ') if style == '[' else ' '}{style}{unit}{']' if style == '[' else ')'}"
        elif unit and style == "_":
            name = f"{name}_{SUFFIX.get(unit, unit)}"
        result.append(column._replace(name=name))
    return result, options


def renamed(options, before, after):
    """The options with the new names of columns."""
    new = dict(zip((c.name for c in before), (c.name for c in after), strict=True))
    columns = {part: [new[name] for name in names] for part, names in options.get("columns", {}).items()}
    return options | ({"columns": columns} if columns else {})
