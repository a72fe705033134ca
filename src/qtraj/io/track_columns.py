"""Select the columns of a recording by the user's names, otherwise by common names, and explain missing columns."""

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from qtraj.io.attitude_angles import OPTIONS as ANGLE_OPTIONS, AttitudeAngles
from qtraj.io.tangent_plane import OPTIONS as PROJECTIONS

COMMON = {
    "time": ("time", "t", "timestamp", "seconds"),
    "position": (
        "x,y,z",
        "px,py,pz",
        "pos_x,pos_y,pos_z",
        "position_x,position_y,position_z",
        "easting,northing,altitude",
        "east,north,up",
        "tx,ty,tz",
    ),
    "velocity": (
        "vx,vy,vz",
        "vel_x,vel_y,vel_z",
        "velocity_x,velocity_y,velocity_z",
        "vel_east,vel_north,vel_up",
        "ve,vn,vu",
    ),
    "attitude": ("qw,qx,qy,qz", "q_w,q_x,q_y,q_z", "quaternion_w,quaternion_x,quaternion_y,quaternion_z"),
    "rate": (
        "angvel_x,angvel_y,angvel_z",
        "wx,wy,wz",
        "gyro_x,gyro_y,gyro_z",
        "omega_x,omega_y,omega_z",
        "rate_x,rate_y,rate_z",
        "angvel_z",
        "wz",
        "gyro_z",
        "omega_z",
        "vertical_rate",
    ),
}
"""Column names that are recognised automatically, in lower case and without units in brackets."""

ANGLED = ("roll,pitch,heading", "roll,pitch,yaw", "roll,pitch,azimuth")
GLOBAL = (
    "latitude,longitude,height",
    "latitude,longitude,altitude",
    "lat,lon,height",
    "lat,lon,altitude",
    "lat,lon,alt",
    "lat,lng,alt",
)
"""Common column names of geographic positions (`GLOBAL`) and of attitudes as angles (`ANGLED`).

Each form is recognised only if the caller selects it.
"""

UNITS = {"time": "s", "position": "m", "velocity": "m/s", "attitude": "", "rate": "rad/s"}
OTHERS = {
    "time": ("ms", "msec", "milliseconds", "us", "µs", "μs", "ns", "min", "h"),
    "position": ("mm", "cm", "km", "ft", "feet", "in", "mi", "deg", "°", "rad"),
    "velocity": ("mm/s", "cm/s", "km/h", "kmh", "kph", "mph", "ft/s", "kn", "kt", "knots", "deg/s", "rad/s"),
    "attitude": ("deg", "°", "rad"),
    "rate": ("deg/s", "°/s", "dps", "mrad/s", "rpm", "m/s"),
}
"""Known units of each quantity that differ from `UNITS`; a column with one of them in brackets is rejected."""

ANGLE_UNITS = {"deg": "deg", "°": "deg", "degrees": "deg", "rad": "rad", "radians": "rad"}
"""Spellings of angle units in the brackets of a column name, and the unit that each spelling denotes."""

GEOGRAPHIC = {"lat", "lon", "lng", "latitude", "longitude"}
"""Words in column names that indicate latitude or longitude instead of positions in metres."""

COUNTS = {"time": 1, "position": 3, "velocity": 3, "attitude": 4, "rate": 3}
REQUIRED = ("time", "position")

ANGLE_WORDS = (("roll",), ("pitch",), ("heading", "yaw"))
"""Words in the column names of roll, pitch and heading."""

MIN_SIMILARITY = 0.7
"""Minimum similarity, from 0 to 1, at which a column name is considered a misspelling of a common name."""

Columns = Mapping[str, str | Sequence[str] | None]


def _require_latitude_first(names: list[str]) -> None:
    """Raise a ValueError if the column names indicate that the longitude comes first."""
    if "lon" in names[0].lower() or "lat" in names[1].lower():
        raise ValueError(
            f"columns['position'] names {names[0]!r} before {names[1]!r}, but the latitude must come first: name "
            "latitude, longitude and height in this order"
        )


def _require_heading_last(names: list[str]) -> None:
    """Raise a ValueError if the column names indicate an order other than roll, pitch, heading."""
    for k, name in enumerate(names):
        indicated = [place for place, words in enumerate(ANGLE_WORDS) if any(word in name.lower() for word in words)]
        if indicated and k not in indicated:
            raise ValueError(
                f"columns['attitude'] names {', '.join(names)}, but the order must be roll, pitch, heading: name "
                "them in this order, whatever the sequence of the rotations"
            )


def choose(
    path: Path, header: list[str], columns: Columns, angles: AttitudeAngles | None = None, globe: bool = False
) -> dict[str, tuple[str, ...]]:
    """Return the column names of each quantity: the names in `columns` or, without such an entry, common names.

    With `angles`, the attitude is given by roll, pitch and heading. With `globe`, the position is given by latitude,
    longitude and height.

    **Raises:** ValueError for an unknown key, a wrong number of columns, three angles without `angles`, or names that
    indicate an order other than latitude, longitude, height or roll, pitch, heading. ValueError with the name of the
    file for columns that do not exist, a missing required quantity, a quantity with incomplete columns (except the
    angular rate), and columns whose names indicate other units.
    """
    if unknown := sorted(set(columns) - set(COUNTS)):
        raise ValueError(f"columns= accepts the keys {', '.join(COUNTS)}, but {unknown[0]!r} was given")
    listed = ", ".join(header)
    chosen: dict[str, tuple[str, ...]] = {}
    angled = angles is not None
    common = COMMON | ({"attitude": ANGLED} if angled else {}) | ({"position": GLOBAL} if globe else {})
    for part, count in (COUNTS | ({"attitude": 3} if angled else {})).items():
        named = columns.get(part)
        names = _common(common[part], header) if part not in columns else (named,) if isinstance(named, str) else named
        if names is None:
            if part == "attitude" and angled and part not in columns:
                raise ValueError(f"{path}: {_no_angles(listed)}")
            if part == "position" and globe:
                raise ValueError(f"{path}: {_no_globe(listed)}")
            if part in REQUIRED or (part not in columns and part != "rate" and _begun(part, header)):
                raise ValueError(f"{path}: {_not_found(part, header)}")
            continue
        if part == "attitude" and not angled and len(names) == 3:
            raise ValueError(
                f"columns['attitude'] names three angles, {', '.join(names)}, which need a convention: pass "
                f"angles=qtraj.AttitudeAngles(sequence=…, heading=…, unit=…, body=…), or write a table [track.angles] "
                f"in the scenario. {ANGLE_OPTIONS}."
            )
        if len(names) != count and not (part == "rate" and len(names) == 1):
            counts = f"{count} column(s)" if part != "rate" else "3 columns, or the column of the yaw rate"
            raise ValueError(f"columns[{part!r}] must name {counts}, but {list(names)!r} was given")
        if missing := [name for name in names if name not in header]:
            raise ValueError(f"{path}: there is no column {missing[0]!r}. The columns are {listed}.")
        if part == "position" and globe:
            _require_latitude_first(list(names))
        if part == "attitude" and angled:
            _require_heading_last(list(names))
        if message := _in_other_units(part, names, angles, globe):
            raise ValueError(f"{path}: {message}")
        chosen[part] = tuple(names)
    return chosen


def _in_other_units(part: str, names: Sequence[str], angles: AttitudeAngles | None, globe: bool) -> str | None:
    """Return a message if a column name indicates another unit or meaning, otherwise None."""
    for k, name in enumerate(names):
        for unit in re.findall(r"[\[(]\s*([^\])]*?)\s*[\])]", name):
            if (part == "attitude" and angles is not None) or (part == "position" and globe and k < 2):
                expected = angles.unit if part == "attitude" and angles is not None else "deg"
                if unit.lower() in ANGLE_UNITS and ANGLE_UNITS[unit.lower()] != expected:
                    return f"the column {name!r} is in {unit}, but the {part} must be in {expected}: convert it first"
            elif unit.lower() in OTHERS[part]:
                expected = f"in {UNITS[part]}" if UNITS[part] else "a quaternion"
                return f"the column {name!r} is in {unit}, but the {part} must be {expected}: convert it first"
        if part == "position" and not globe and GEOGRAPHIC.intersection(re.split(r"[^a-z]+", name.lower())):
            return (
                f"the column {name!r} seems to contain geographic coordinates, but positions must be in m: convert "
                f"latitude and longitude to metres first (for example with pyproj), or use {PROJECTIONS}"
            )
    return None


def _no_angles(listed: str) -> str:
    return (
        f"no columns for roll, pitch and heading were found. The file has the columns {listed}. Name the columns "
        'of roll, pitch and heading, in this order: in a scenario with attitude = ["...", "...", "..."] under '
        '[track.columns], in Python with columns={"attitude": [...]}.'
    )


def _no_globe(listed: str) -> str:
    return (
        f"no columns for latitude, longitude and height were found. The file has the columns {listed}. Name the "
        'columns of latitude, longitude and height, in this order: in a scenario with position = ["...", "...", "..."] '
        'under [track.columns], in Python with columns={"position": [...]}.'
    )


def _common(choices: Sequence[str], header: list[str]) -> tuple[str, ...] | None:
    plain = _plain(header)
    for choice in choices:
        names = choice.split(",")
        if all(name in plain for name in names):
            return tuple(plain[name] for name in names)
    return None


def _begun(part: str, header: list[str]) -> bool:
    """Return whether the file has any column with a common name of this quantity."""
    plain = _plain(header)
    return any(name in plain for choice in COMMON[part] for name in choice.split(","))


def _plain(header: list[str]) -> dict[str, str]:
    """Map column names in lower case and without units to the original names."""
    return {re.sub(r"\s*[\[(].*$", "", name).strip().lower(): name for name in reversed(header)}


def _not_found(part: str, header: list[str]) -> str:
    """Return the message about a missing or incomplete quantity, with advice for Python and for scenarios."""
    plain = _plain(header)
    common = [choice.split(",") for choice in COMMON[part]]
    best = max(common, key=lambda names: sum(name in plain for name in names))
    present = [plain[name] for name in best if name in plain]
    missing = [name for name in best if name not in plain]
    what, example = f"no columns for the {part} were found", "..."
    if present and missing:
        what = f"the columns for the {part} are incomplete: found {', '.join(present)}, missing {', '.join(missing)}"
        likely = [plain.get(name) or _likely(part, k, plain) for k, name in enumerate(best)]
        example = "[" + ", ".join(f'"{name}"' for name in likely) + "]"
    omit = f' To omit the {part}, write {part} = [] in the scenario, or {{"{part}": None}} in Python.'
    without = "" if part in REQUIRED else omit
    return (
        f"{what}. The columns are {', '.join(header)}; name the columns of the {part}: "
        f'in a scenario with {part} = {example} under [track.columns], in Python with columns={{"{part}": {example}}}.'
        f"{without}{_on_the_globe(part, header)}"
    )


def _on_the_globe(part: str, header: list[str]) -> str:
    """Return advice if the file contains latitudes or longitudes instead of positions, otherwise an empty string."""
    words = {word for name in header for word in re.split(r"[^a-z]+", name.lower())}
    return f" Latitude and longitude are read with {PROJECTIONS}." if part == "position" and words & GEOGRAPHIC else ""


def _likely(part: str, k: int, plain: Mapping[str, str]) -> str:
    """Return a column whose name resembles a common name of the k-th component, or "..." if there is none."""
    names = [choice.split(",")[k] for choice in COMMON[part]]
    common = {name for choices in COMMON.values() for choice in choices for name in choice.split(",")}
    others = [name for name in plain if name not in common]
    similar = [plain[name] for name in others if difflib.get_close_matches(name, names, 1, MIN_SIMILARITY)]
    return similar[0] if similar else "..."
