"""Which columns of a recording hold what: those told, else common names, and what to say where they are not there."""

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

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

UNITS = {"time": "s", "position": "m", "velocity": "m/s", "attitude": ""}
OTHERS = {
    "time": ("ms", "msec", "milliseconds", "us", "µs", "μs", "ns", "min", "h"),
    "position": ("mm", "cm", "km", "ft", "feet", "in", "mi", "deg", "°", "rad"),
    "velocity": ("mm/s", "cm/s", "km/h", "kmh", "kph", "mph", "ft/s", "kn", "kt", "knots", "deg/s", "rad/s"),
    "attitude": ("deg", "°", "rad"),
}
"""The unit of each part, and others that a column's name may give in brackets."""

GEOGRAPHIC = {"lat", "lon", "lng", "latitude", "longitude"}
"""Words in names of columns that hold angles on the globe, and no positions in metres."""

COUNTS = {"time": 1, "position": 3, "velocity": 3, "attitude": 4}
NEEDED = ("time", "position")

LIKE = 0.7
"""A column less alike a common name than this, from 0 to 1, is not taken for it misspelt."""

Columns = Mapping[str, str | Sequence[str] | None]


def choose(path: Path, header: list[str], columns: Columns) -> dict[str, tuple[str, ...]]:
    """The columns of each part that is there: those told, else common ones.

    **Raises:** ValueError naming the file for columns that are not there, for a part that must be there and is not, and
    for one of which only some columns have common names, or whose columns by their names are in other units.
    """
    if unknown := sorted(set(columns) - set(COUNTS)):
        raise ValueError(f"columns= knows the keys {', '.join(COUNTS)}, but {unknown[0]!r} was given")
    listed = ", ".join(header)
    chosen: dict[str, tuple[str, ...]] = {}
    for part, count in COUNTS.items():
        told = columns.get(part)
        names = _common(part, header) if part not in columns else (told,) if isinstance(told, str) else told
        if names is None:
            if part in NEEDED or (part not in columns and _begun(part, header)):
                raise ValueError(f"{path}: {_not_found(part, header)}")
            continue
        if len(names) != count:
            raise ValueError(f"columns[{part!r}] must name {count} column(s), but {list(names)!r} was given")
        if missing := [name for name in names if name not in header]:
            raise ValueError(f"{path}: there is no column {missing[0]!r}. The columns are {listed}.")
        if trouble := _in_other_units(part, names):
            raise ValueError(f"{path}: {trouble}")
        chosen[part] = tuple(names)
    return chosen


def _in_other_units(part: str, names: Sequence[str]) -> str | None:
    """What to say of columns that by their names hold something else than what is read."""
    for name in names:
        for unit in re.findall(r"[\[(]\s*([^\])]*?)\s*[\])]", name):
            if unit.lower() in OTHERS[part]:
                wanted = f"in {UNITS[part]}" if UNITS[part] else "as a quaternion"
                return f"the column {name!r} is in {unit}, but the {part} is read {wanted}: convert it before"
        if part == "position" and GEOGRAPHIC.intersection(re.split(r"[^a-z]+", name.lower())):
            return (
                f"the column {name!r} seems to hold angles on the globe, but positions are read in m: project latitude "
                "and longitude to metres before (as pyproj does)"
            )
    return None


def _common(part: str, header: list[str]) -> tuple[str, ...] | None:
    plain = _plain(header)
    for choice in COMMON[part]:
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
        f"{without}"
    )


def _likely(part: str, k: int, plain: Mapping[str, str]) -> str:
    """The column whose name is nearly a common one of the k-th component; dots where there is none."""
    kin = [choice.split(",")[k] for choice in COMMON[part]]
    known = {name for choices in COMMON.values() for choice in choices for name in choice.split(",")}
    like = [plain[name] for name in plain if name not in known and difflib.get_close_matches(name, kin, 1, LIKE)]
    return like[0] if like else "..."
