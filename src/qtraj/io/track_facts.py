"""State in four lines what was read from a recording, and as what."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from qtraj.io.column_names import HEADING, SPEED, find
from qtraj.io.column_units import Unit
from qtraj.io.recorded_axes import MEANING
from qtraj.io.recorded_times import Times

UNITS = {"position": "m", "velocity": "m/s", "attitude": "scalar first", "rate": "rad/s"}
MAX_LEFT_OUT = 8


class Columns(NamedTuple):
    """The columns that were read: their names, their units (None: the units of a track) and their axes."""

    header: Sequence[str]
    chosen: Mapping[str, tuple[str, ...]]
    units: Mapping[str, Sequence[Unit | None]]
    axes: Mapping[str, str]
    angles: bool = False


def facts(columns: Columns, times: Times, given_times: str = "") -> tuple[str, str, str, str]:
    """Return four lines of text: the time, the position, the other quantities, and the columns left out.

    `given_times` describes the source of times that are not in the file.
    """
    others = [part for part in ("velocity", "attitude", "rate") if part in columns.chosen]
    used = {name for names in columns.chosen.values() for name in names}
    left = [name for name in columns.header if name not in used]
    return (
        _time(columns, times, given_times),
        _quantity(columns, "position"),
        "; ".join(_quantity(columns, part) for part in others) or "velocity, attitude and rate: none",
        _left_out(left),
    )


def _time(columns: Columns, times: Times, given: str) -> str:
    name = columns.chosen["time"][0]
    origin = f", in seconds after {times.origin}" if times.origin else ""
    note = f", {times.note}" if times.note else ""
    column = f"column {list(columns.header).index(name) + 1} {name!r}"
    return f"time: {given or column}, {times.unit}{note}{origin}"


def _quantity(columns: Columns, part: str) -> str:
    names, axes = columns.chosen[part], columns.axes[part]
    if part == "attitude" and columns.angles:
        return f"attitude: {', '.join(names)}, as roll, pitch, heading"
    symbols = list(dict.fromkeys(UNITS[part] if unit is None else unit.symbol for unit in columns.units[part]))
    if axes == "geographic":
        units = columns.units[part]
        symbols = ["deg" if units[0] is None else units[0].symbol]
        symbols += ["m" if units[2] is None else units[2].symbol] if len(names) == 3 else ["height 0 m"]
    body = {"ned": ", body axes forward, right, down", "camera": ", body axes right, down, forward"}
    meaning = body.get(axes, "") if part in ("attitude", "rate") else f", as {_meaning(axes, part)}"
    return f"{part}: {', '.join(names)}, {', '.join(symbols)}{meaning}"


def _meaning(axes: str, part: str) -> str:
    return MEANING[axes] if part == "position" or axes != "geographic" else MEANING["enu"]


def _left_out(left: list[str]) -> str:
    known = [
        f"{word} {found[0]!r}"
        for word, names in (("speed", SPEED), ("heading", HEADING))
        if (found := find(names, left))
    ]
    more = ", …" if len(left) > MAX_LEFT_OUT else ""
    recognised = f" (with {' and '.join(known)}, which a track does not contain)" if known else ""
    return f"left out: {', '.join(left[:MAX_LEFT_OUT]) or 'nothing'}{more}{recognised}"
