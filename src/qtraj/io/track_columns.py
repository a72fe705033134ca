"""Select the columns of a recording by the user's names, otherwise by common names, and explain missing columns."""

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from qtraj.io.attitude_angles import OPTIONS as ANGLE_OPTIONS, AttitudeAngles
from qtraj.io.column_names import ANGLED, COMMON, GLOBAL, MORE, find, plain, squeezed
from qtraj.io.given_times import NO_TIMES
from qtraj.io.tangent_plane import OPTIONS as PROJECTIONS

GEOGRAPHIC = {"lat", "lon", "lng", "latitude", "longitude"}
"""Words in column names that indicate latitude or longitude instead of positions in metres."""

COUNTS = {"time": 1, "position": 3, "velocity": 3, "attitude": 4, "rate": 3}
REQUIRED = ("time", "position")

ANGLE_WORDS = (("roll",), ("pitch",), ("heading", "yaw"))
"""Words in the column names of roll, pitch and heading."""

MIN_SIMILARITY = 0.7
"""Minimum similarity, from 0 to 1, at which a column name is considered a misspelling of a common name."""

MAX_VALUES = 12
"""Maximum number of first values in a message."""

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
    path: Path,
    header: list[str],
    columns: Columns,
    angles: AttitudeAngles | None = None,
    globe: bool = False,
    first: Sequence[str] = (),
) -> dict[str, tuple[str, ...]]:
    """Return the column names of each quantity: the names in `columns` or, without such an entry, common names.

    With `angles`, the attitude is given by roll, pitch and heading. With `globe`, the position is given by latitude,
    longitude and, if recorded, height. `first` is the first row, for the messages.

    **Raises:** ValueError for an unknown key, a wrong number of columns, three angles without `angles`, or names that
    indicate an order other than latitude, longitude, height or roll, pitch, heading. ValueError with the name of the
    file for columns that do not exist, a missing required quantity, and a quantity with incomplete columns (except the
    angular rate).
    """
    if unknown := sorted(set(columns) - set(COUNTS)):
        raise ValueError(f"columns= accepts the keys {', '.join(COUNTS)}, but {unknown[0]!r} was given")
    chosen: dict[str, tuple[str, ...]] = {}
    for part in COUNTS:
        named = columns.get(part)
        names = _recognised(part, header, angles, globe) if part not in columns else named
        if names is None:
            if message := _missing(part, header, columns, angles, globe):
                raise ValueError(f"{path}: {message}{_first_values(header, first)}")
            continue
        names = (names,) if isinstance(names, str) else tuple(names)
        _require_count(part, names, angles, globe)
        if absent := [name for name in names if name not in header]:
            raise ValueError(
                f"{path}: there is no column {absent[0]!r}. The columns are {', '.join(header)}."
                f"{_first_values(header, first)}"
            )
        if part == "position" and globe:
            _require_latitude_first(list(names))
        if part == "position" and not globe and (message := _geographic(names)):
            raise ValueError(f"{path}: {message}")
        if part == "attitude" and angles is not None:
            _require_heading_last(list(names))
        chosen[part] = names
    return chosen


def has_geographic_position(header: list[str]) -> bool:
    """Return whether a file has the columns latitude and longitude, and no position in metres."""
    return find((*COMMON["position"], *MORE["position"]), header) is None and find(GLOBAL, header) is not None


def _recognised(part: str, header: list[str], angles: AttitudeAngles | None, globe: bool) -> tuple[str, ...] | None:
    if part == "attitude" and angles is not None:
        return find(ANGLED, header)
    if part == "position" and globe:
        return find(GLOBAL, header)
    return find((*COMMON[part], *MORE[part]), header)


def _missing(part: str, header: list[str], columns: Columns, angles: AttitudeAngles | None, globe: bool) -> str | None:
    """Return the message about a quantity without columns, or None if the quantity may be absent."""
    if part == "attitude" and angles is not None and part not in columns:
        return _no_angles(", ".join(header))
    if part == "position" and globe:
        return _no_globe(", ".join(header))
    if part in REQUIRED or (part not in columns and part != "rate" and _begun(part, header)):
        return _not_found(part, header)
    return None


def _require_count(part: str, names: tuple[str, ...], angles: AttitudeAngles | None, globe: bool) -> None:
    if part == "attitude" and angles is None and len(names) == 3:
        raise ValueError(
            f"columns['attitude'] names three angles, {', '.join(names)}, which need a convention: pass "
            f"angles=qtraj.AttitudeAngles(sequence=…, heading=…, unit=…, body=…), or write a table [track.angles] "
            f"in the scenario. {ANGLE_OPTIONS}."
        )
    count = 3 if part == "attitude" and angles is not None else COUNTS[part]
    allowed = {count} | ({1} if part == "rate" else set()) | ({2} if part == "position" and globe else set())
    if len(names) not in allowed:
        counts = f"{count} column(s)" if part != "rate" else "3 columns, or the column of the yaw rate"
        raise ValueError(f"columns[{part!r}] must name {counts}, but {list(names)!r} was given")


def _geographic(names: Sequence[str]) -> str | None:
    """Return a message if a column name indicates latitude or longitude instead of a position in metres."""
    for name in names:
        if GEOGRAPHIC.intersection(re.split(r"[^a-z]+", name.lower())):
            return (
                f"the column {name!r} seems to contain geographic coordinates, but positions must be in m: convert "
                f"latitude and longitude to metres first (for example with pyproj), or use {PROJECTIONS}"
            )
    return None


def _first_values(header: list[str], first: Sequence[str]) -> str:
    pairs = [f"{name} = {cell.strip()}" for name, cell in zip(header, first, strict=False)]
    more = ", …" if len(pairs) > MAX_VALUES else ""
    return f" The first values are {', '.join(pairs[:MAX_VALUES])}{more}." if pairs else ""


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


def _begun(part: str, header: list[str]) -> bool:
    """Return whether the file has any column with a common name of this quantity."""
    known = plain(header)
    return any(squeezed(name) in known for choice in COMMON[part] for name in choice.split(","))


def _not_found(part: str, header: list[str]) -> str:
    """Return the message about a missing or incomplete quantity, with advice for Python and for scenarios."""
    known = plain(header)
    common = [choice.split(",") for choice in COMMON[part]]
    best = max(common, key=lambda names: sum(squeezed(name) in known for name in names))
    present = [known[squeezed(name)] for name in best if squeezed(name) in known]
    missing = [name for name in best if squeezed(name) not in known]
    what, example = f"no columns for the {part} were found", "..."
    if present and missing:
        what = f"the columns for the {part} are incomplete: found {', '.join(present)}, missing {', '.join(missing)}"
        likely = [known.get(squeezed(name)) or _likely(part, k, known) for k, name in enumerate(best)]
        example = "[" + ", ".join(f'"{name}"' for name in likely) + "]"
    omit = f' To omit the {part}, write {part} = [] in the scenario, or {{"{part}": None}} in Python.'
    without = "" if part in REQUIRED else omit
    return (
        f"{what}. The columns are {', '.join(header)}; name the columns of the {part}: "
        f'in a scenario with {part} = {example} under [track.columns], in Python with columns={{"{part}": {example}}}.'
        f"{without}{_without_times(header) if part == 'time' else ''}{_on_the_globe(part, header)}"
    )


def _without_times(header: list[str]) -> str:
    """Return advice for a file without times."""
    known = plain(header)
    flat = {"x", "y"} <= known.keys() and "z" not in known
    shape = " A line without times and heights, such as the centre line of a race track, is a shape, not a track."
    return (shape if flat else "") + NO_TIMES


def _on_the_globe(part: str, header: list[str]) -> str:
    """Return advice if the file contains latitudes or longitudes instead of positions, otherwise an empty string."""
    words = {word for name in header for word in re.split(r"[^a-z]+", name.lower())}
    return f" Latitude and longitude are read with {PROJECTIONS}." if part == "position" and words & GEOGRAPHIC else ""


def _likely(part: str, k: int, known: Mapping[str, str]) -> str:
    """Return a column whose name resembles a common name of the k-th component, or "..." if there is none."""
    names = [squeezed(choice.split(",")[k]) for choice in COMMON[part]]
    common = {squeezed(name) for choices in COMMON.values() for choice in choices for name in choice.split(",")}
    others = [name for name in known if name not in common]
    similar = [known[name] for name in others if difflib.get_close_matches(name, names, 1, MIN_SIMILARITY)]
    return similar[0] if similar else "..."
