"""Explain which columns of a recording are missing, and what to write instead."""

import difflib
import re
from collections.abc import Mapping, Sequence

from qtraj.io.track.column_names import plain, squeezed
from qtraj.io.track.given_times import NO_TIMES
from qtraj.io.track.known_names import COMMON
from qtraj.io.track.tangent_plane import OPTIONS as PROJECTIONS

GEOGRAPHIC = {"lat", "lon", "lng", "latitude", "longitude"}
"""Words in column names that indicate latitude or longitude instead of positions in metres."""

REQUIRED = ("time", "position")

MIN_SIMILARITY = 0.7
"""Minimum similarity, from 0 to 1, at which a column name is considered a misspelling of a common name."""

MAX_VALUES, MAX_NAMES, MAX_LENGTH = 12, 30, 40
"""Maximum numbers of first values and of column names in a message, and maximum number of characters of each."""


def listed(header: Sequence[str]) -> str:
    """Return the column names between commas, shortened for a message."""
    return ", ".join(map(shortened, header[:MAX_NAMES])) + (", …" if len(header) > MAX_NAMES else "")


def shortened(text: str) -> str:
    """Return a text of at most `MAX_LENGTH` characters on one line."""
    text = text.strip()
    return text if len(text) <= MAX_LENGTH else text[:MAX_LENGTH] + "…"


def first_values(header: list[str], first: Sequence[str]) -> str:
    """Return the names and the first values of the columns as the end of a message."""
    pairs = [f"{shortened(name)} = {shortened(cell)}" for name, cell in zip(header, first, strict=False)]
    more = ", …" if len(pairs) > MAX_VALUES else ""
    return f" The first values are {', '.join(pairs[:MAX_VALUES])}{more}." if pairs else ""


def no_angles(names: str) -> str:
    """Return the message about missing columns of roll, pitch and heading."""
    return (
        f"no columns for roll, pitch and heading were found. The file has the columns {names}. Name the columns "
        'of roll, pitch and heading, in this order: in a scenario with attitude = ["...", "...", "..."] under '
        '[track.columns], in Python with columns={"attitude": [...]}.'
    )


def no_globe(names: str) -> str:
    """Return the message about missing columns of latitude, longitude and height."""
    return (
        f"no columns for latitude, longitude and height were found. The file has the columns {names}. Name the "
        'columns of latitude, longitude and height, in this order: in a scenario with position = ["...", "...", "..."] '
        'under [track.columns], in Python with columns={"position": [...]}.'
    )


def begun(part: str, header: list[str]) -> bool:
    """Return whether the file has any column with a common name of this quantity."""
    known = plain(header)
    return any(squeezed(name) in known for choice in COMMON[part] for name in choice.split(","))


def not_found(part: str, header: list[str]) -> str:
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
    omit = (
        f' To omit the {part}, write {part} = [] in the scenario, or {{"{part}": None}} in Python, or '
        f"--columns {part}= on the command line."
    )
    without = "" if part in REQUIRED else omit
    if part == "position" and len(present) == 2 and missing == [best[2]]:
        omit = f' If all heights are 0, name two columns: position = ["{present[0]}", "{present[1]}"].'
        without = omit
    return (
        f"{what}. The columns are {listed(header)}; name the columns of the {part}: "
        f'in a scenario with {part} = {example} under [track.columns], in Python with columns={{"{part}": {example}}}, '
        f"on the command line with --columns {part}={'...' if part == 'time' else 'a,b,c'}."
        f"{without}{_without_times(header) if part == 'time' else ''}{_on_the_globe(part, header)}"
    )


def _without_times(header: list[str]) -> str:
    """Return advice for a file without times."""
    known = plain(header)
    flat = {"x", "y"} <= known.keys() and "z" not in known
    shape = (
        " A line without times and heights, such as the centre line of a race track, is a shape, not a track: read it "
        "with qtraj.read_shape."
    )
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
