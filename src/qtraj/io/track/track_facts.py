"""State in four lines what was read from a recording, and as what."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from qtraj.io.track.column_names import find, squeezed
from qtraj.io.track.column_units import Unit
from qtraj.io.track.known_names import CURVATURE, HEADING, SPEED
from qtraj.io.track.limit_columns import LimitSamples
from qtraj.io.track.recorded_axes import MEANING
from qtraj.io.track.recorded_line import RecordedLine
from qtraj.io.track.recorded_times import Times
from qtraj.io.track.row_facts import row_text
from qtraj.io.track.segments import Segment
from qtraj.io.track.tangent_plane import place_text
from qtraj.io.track.utm import look_like_utm
from qtraj.path.track import Track

UNITS = {"position": "m", "velocity": "m/s", "attitude": "scalar first", "rate": "rad/s"}
MAX_LEFT_OUT = 8


class Columns(NamedTuple):
    """The columns that were read: their names, their units (None: the units of a track) and their axes."""

    header: Sequence[str]
    chosen: Mapping[str, tuple[str, ...]]
    units: Mapping[str, Sequence[Unit | None]]
    axes: Mapping[str, str]
    angles: bool = False


def facts(
    columns: Columns,
    times: Times,
    given_times: str,
    track: Track,
    rows: Segment,
    notes: Sequence[str] = (),
    line: RecordedLine | None = None,
    origin: Sequence[float] | None = None,
    limits: Mapping[str, LimitSamples] = MappingProxyType({}),
) -> tuple[str, str, str, str]:
    """Return four lines of text: the time, the position, the other quantities, and the rows with what was left out.

    `given_times` describes the source of times that are not in the file, and `notes` rows that were combined or left
    out. `line`: heading and curvature of a race line, which are compared with the fitted route. `origin`: latitude and
    longitude [°] of the first sample.
    """
    others = [part for part in ("velocity", "attitude", "rate") if part in columns.chosen]
    used = {name for names in columns.chosen.values() for name in names}
    used |= set() if line is None else {name for name in line.columns if name is not None}
    used |= {limit.column for limit in limits.values()}
    left = [name for name in columns.header if name not in used and repr(name) not in given_times]
    texts = [_quantity(columns, part) for part in others] + ([] if line is None else [line.text()])
    texts += [limit.text(name) for name, limit in limits.items()]
    return (
        _time(columns, times, given_times),
        _quantity(columns, "position")
        + ("" if origin is None else f", from {place_text(origin[0], origin[1])}")
        + (", UTM by their size" if columns.axes["position"] != "geographic" and look_like_utm(track) else ""),
        "; ".join(texts) or "velocity, attitude and rate: none",
        "; ".join(filter(None, (row_text(track, rows), *notes, _left_out(left)))),
    )


def _time(columns: Columns, times: Times, given: str) -> str:
    names = columns.chosen["time"]
    origin = f", in seconds after {times.origin}" if times.origin else ""
    note = f", {times.note}" if times.note else ""
    places = [] if given else [f"column {list(columns.header).index(name) + 1} {name!r}" for name in names]
    return f"time: {given or ' and '.join(places)}, {times.unit}{note}{origin}"


def _quantity(columns: Columns, part: str) -> str:
    names, axes = columns.chosen[part], columns.axes[part]
    if part == "attitude" and columns.angles:
        return f"attitude: {', '.join(names)}, as roll, pitch, heading"
    if part == "attitude" and len(names) == 9:
        return f"attitude: {', '.join(names)}, as a matrix from body to world axes, row by row"
    symbols = list(dict.fromkeys(UNITS[part] if unit is None else unit.symbol for unit in columns.units[part]))
    if axes == "geographic":
        units = columns.units[part]
        symbols = ["deg" if units[0] is None else units[0].symbol]
        symbols += ["m" if units[2] is None else units[2].symbol] if len(names) == 3 else ["height 0 m"]
    elif part == "position" and len(names) == 2:
        symbols.append("height 0 m")
    body = {"ned": ", body axes forward, right, down", "camera": ", body axes right, down, forward"}
    meaning = body.get(axes, "") if part in ("attitude", "rate") else f", as {_meaning(axes, part)}"
    return f"{part}: {', '.join(names)}, {', '.join(symbols)}{meaning}"


def _meaning(axes: str, part: str) -> str:
    return MEANING[axes] if part == "position" or axes != "geographic" else MEANING["enu"]


def _left_out(left: list[str]) -> str:
    known = [
        f"{word} {found[0]!r}{' in kn' if squeezed(found[0]) == 'sog' else ''}"
        for word, names in (("speed", SPEED), ("heading", HEADING), ("curvature", CURVATURE))
        if (found := find(names, left))
    ]
    more = ", …" if len(left) > MAX_LEFT_OUT else ""
    recognised = f" (with {' and '.join(known)}, which a track does not contain)" if known else ""
    return f"left out: {', '.join(left[:MAX_LEFT_OUT]) or 'nothing'}{more}{recognised}"
