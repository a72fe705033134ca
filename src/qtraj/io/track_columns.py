"""Which columns of a recording hold what: those told, else common names, and what to say where they are not there."""

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
}
"""Column names that are recognised without being told, in lower case and without units in brackets."""

ANGLED = ("roll,pitch,heading", "roll,pitch,yaw", "roll,pitch,azimuth")
GLOBAL = (
    "latitude,longitude,height",
    "latitude,longitude,altitude",
    "lat,lon,height",
    "lat,lon,altitude",
    "lat,lon,alt",
    "lat,lng,alt",
)
"""The same of attitudes as angles, and of positions on the globe, where they are asked for."""

UNITS = {"time": "s", "position": "m", "velocity": "m/s", "attitude": ""}
OTHERS = {
    "time": ("ms", "msec", "milliseconds", "us", "µs", "μs", "ns", "min", "h"),
    "position": ("mm", "cm", "km", "ft", "feet", "in", "mi", "deg", "°", "rad"),
    "velocity": ("mm/s", "cm/s", "km/h", "kmh", "kph", "mph", "ft/s", "kn", "kt", "knots", "deg/s", "rad/s"),
    "attitude": ("deg", "°", "rad"),
}
"""The unit of each part, and others that a column's name may give in brackets."""

ANGLE_UNITS = {"deg": "deg", "°": "deg", "degrees": "deg", "rad": "rad", "radians": "rad"}
"""The units of angles that a column's name may give in brackets."""

GEOGRAPHIC = {"lat", "lon", "lng", "latitude", "longitude"}
"""Words in names of columns that hold angles on the globe, and no positions in metres."""

COUNTS = {"time": 1, "position": 3, "velocity": 3, "attitude": 4}
NEEDED = ("time", "position")

ANGLE_WORDS = (("roll",), ("pitch",), ("heading", "yaw"))
"""Words in the names of columns that tell roll, pitch and heading."""

LIKE = 0.7
"""A column less alike a common name than this, from 0 to 1, is not taken for it misspelt."""

Columns = Mapping[str, str | Sequence[str] | None]


def _require_latitude_first(names: list[str]) -> None:
    """Raise a ValueError where the names say that the longitude comes first."""
    if "lon" in names[0].lower() or "lat" in names[1].lower():
        raise ValueError(
            f"columns['position'] names {names[0]!r} before {names[1]!r}, but latitude comes before longitude: name "
            "latitude, longitude and height in this order"
        )


def _require_heading_last(names: list[str]) -> None:
    """Raise a ValueError where the names say that the angles come in another order than roll, pitch, heading."""
    for k, name in enumerate(names):
        found = [place for place, words in enumerate(ANGLE_WORDS) if any(word in name.lower() for word in words)]
        if found and k not in found:
            raise ValueError(
                f"columns['attitude'] names {', '.join(names)}, but the order is roll, pitch, heading: name them in "
                "this order, whatever the sequence of the rotations"
            )


def choose(
    path: Path, header: list[str], columns: Columns, angles: AttitudeAngles | None = None, globe: bool = False
) -> dict[str, tuple[str, ...]]:
    """The columns of each part that is there: those told, else common ones.

    With `angles` the attitude is roll, pitch and heading; on the `globe` the position is latitude, longitude, height.

    **Raises:** ValueError naming the file for columns that are not there, for a part that must be there and is not, and
    for one of which only some columns have common names, or whose columns by their names are in other units.
    """
    if unknown := sorted(set(columns) - set(COUNTS)):
        raise ValueError(f"columns= knows the keys {', '.join(COUNTS)}, but {unknown[0]!r} was given")
    listed = ", ".join(header)
    chosen: dict[str, tuple[str, ...]] = {}
    angled = angles is not None
    common = COMMON | ({"attitude": ANGLED} if angled else {}) | ({"position": GLOBAL} if globe else {})
    for part, count in (COUNTS | ({"attitude": 3} if angled else {})).items():
        told = columns.get(part)
        names = _common(common[part], header) if part not in columns else (told,) if isinstance(told, str) else told
        if names is None:
            if part == "attitude" and angled and part not in columns:
                raise ValueError(f"{path}: {_no_angles(listed)}")
            if part == "position" and globe:
                raise ValueError(f"{path}: {_no_globe(listed)}")
            if part in NEEDED or (part not in columns and _begun(part, header)):
                raise ValueError(f"{path}: {_not_found(part, header)}")
            continue
        if part == "attitude" and not angled and len(names) == 3:
            raise ValueError(
                f"columns['attitude'] names three angles, {', '.join(names)}, whose convention must be told: pass "
                f"angles=qtraj.AttitudeAngles(sequence=…, heading=…, unit=…, body=…), in a scenario a table "
                f"[track.angles]. {ANGLE_OPTIONS}."
            )
        if len(names) != count:
            raise ValueError(f"columns[{part!r}] must name {count} column(s), but {list(names)!r} was given")
        if missing := [name for name in names if name not in header]:
            raise ValueError(f"{path}: there is no column {missing[0]!r}. The columns are {listed}.")
        if part == "position" and globe:
            _require_latitude_first(list(names))
        if part == "attitude" and angled:
            _require_heading_last(list(names))
        if trouble := _in_other_units(part, names, angles, globe):
            raise ValueError(f"{path}: {trouble}")
        chosen[part] = tuple(names)
    return chosen


def _in_other_units(part: str, names: Sequence[str], angles: AttitudeAngles | None, globe: bool) -> str | None:
    """What to say of columns that by their names hold something else than what is read."""
    for k, name in enumerate(names):
        for unit in re.findall(r"[\[(]\s*([^\])]*?)\s*[\])]", name):
            if (part == "attitude" and angles is not None) or (part == "position" and globe and k < 2):
                wanted = angles.unit if part == "attitude" and angles is not None else "deg"
                if unit.lower() in ANGLE_UNITS and ANGLE_UNITS[unit.lower()] != wanted:
                    return f"the column {name!r} is in {unit}, but the {part} is read in {wanted}"
            elif unit.lower() in OTHERS[part]:
                wanted = f"in {UNITS[part]}" if UNITS[part] else "as a quaternion"
                return f"the column {name!r} is in {unit}, but the {part} is read {wanted}: convert it before"
        if part == "position" and not globe and GEOGRAPHIC.intersection(re.split(r"[^a-z]+", name.lower())):
            return (
                f"the column {name!r} seems to hold angles on the globe, but positions are read in m: project latitude "
                f"and longitude to metres before (as pyproj does), or ask for it with {PROJECTIONS}"
            )
    return None


def _no_angles(listed: str) -> str:
    return (
        f"no columns for roll, pitch and heading were found. The columns are {listed}; name them, in this order: in a "
        'scenario with attitude = ["...", "...", "..."] under [track.columns], in Python with '
        'columns={"attitude": [...]}.'
    )


def _no_globe(listed: str) -> str:
    return (
        f"no columns for latitude, longitude and height were found. The columns are {listed}; name them, in this "
        'order: in a scenario with position = ["...", "...", "..."] under [track.columns], in Python with '
        'columns={"position": [...]}.'
    )


def _common(choices: Sequence[str], header: list[str]) -> tuple[str, ...] | None:
    plain = _plain(header)
    for choice in choices:
        names = choice.split(",")
        if all(name in plain for name in names):
            return tuple(plain[name] for name in names)
    return None


def _begun(part: str, header: list[str]) -> bool:
    """Whether there is any column of a part, by its common names."""
    plain = _plain(header)
    return any(name in plain for choice in COMMON[part] for name in choice.split(","))


def _plain(header: list[str]) -> dict[str, str]:
    """The columns by their names in lower case and without units."""
    return {re.sub(r"\s*[\[(].*$", "", name).strip().lower(): name for name in reversed(header)}


def _not_found(part: str, header: list[str]) -> str:
    """What there is of a part and what is missing, and how to name its columns, in Python and in a scenario."""
    plain = _plain(header)
    common = [choice.split(",") for choice in COMMON[part]]
    best = max(common, key=lambda names: sum(name in plain for name in names))
    found = [plain[name] for name in best if name in plain]
    missing = [name for name in best if name not in plain]
    what, example = f"no columns for the {part} were found", "..."
    if found and missing:
        what = f"the columns for the {part} are incomplete: found {', '.join(found)}, missing {', '.join(missing)}"
        likely = [plain.get(name) or _likely(part, k, plain) for k, name in enumerate(best)]
        example = "[" + ", ".join(f'"{name}"' for name in likely) + "]"
    without = "" if part in NEEDED else f' To do without: {part} = [], in Python {{"{part}": None}}.'
    return (
        f"{what}. The columns are {', '.join(header)}; name those of the {part}: "
        f'in a scenario with {part} = {example} under [track.columns], in Python with columns={{"{part}": {example}}}.'
        f"{without}{_on_the_globe(part, header)}"
    )


def _on_the_globe(part: str, header: list[str]) -> str:
    """What to say where there are latitudes and longitudes instead of positions."""
    words = {word for name in header for word in re.split(r"[^a-z]+", name.lower())}
    return f" Latitude and longitude are read with {PROJECTIONS}." if part == "position" and words & GEOGRAPHIC else ""


def _likely(part: str, k: int, plain: Mapping[str, str]) -> str:
    """The column whose name is nearly a common one of the k-th component; dots where there is none."""
    kin = [choice.split(",")[k] for choice in COMMON[part]]
    known = {name for choices in COMMON.values() for choice in choices for name in choice.split(",")}
    like = [plain[name] for name in plain if name not in known and difflib.get_close_matches(name, kin, 1, LIKE)]
    return like[0] if like else "..."
