"""Read the sentences of NMEA receivers with pynmeagps: positions of GGA, or of RMC if there are none."""

import io
import re
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.extras import require_package
from qtraj.io.track.column_table import ColumnTable

HEAD = 20
"""Number of lines at the start of a file by which its format is recognised."""

EPOCH = date(1970, 1, 1)
HALF_DAY = timedelta(hours=12)

_SENTENCE = re.compile(rb"[$!][A-Z]{2}[A-Z0-9]{3},[^*]*(?:\*[0-9A-Fa-f]{2})?")
"""A sentence, before and after which a logger may have written times."""


def is_nmea(data: bytes) -> bool:
    """Return whether half of the first lines, or more, are sentences."""
    lines = [line for line in data[:4096].splitlines()[:HEAD] if line.strip()]
    return bool(lines) and 2 * sum(_SENTENCE.search(line) is not None for line in lines) >= len(lines)


def read_nmea(path: Path, data: bytes) -> tuple[ColumnTable, tuple[str, ...]]:
    """Return the positions of a file, and notes about what was left out.

    A height is the altitude above the geoid plus the separation of the geoid from the ellipsoid. If one of the
    sentences has no separation, all heights are above the geoid. Sentences without an altitude are left out if others
    have one. Times are dates if a sentence contains the date, otherwise seconds of the day.

    **Raises:** ValueError for a file without positions; ModuleNotFoundError without pynmeagps.
    """
    messages, faulty = _messages(path, data)
    fixes = [m for m in messages if m.msgID == "GGA"] or [m for m in messages if m.msgID == "RMC"]
    placed = [m for m in fixes if _is_valid(m)]
    valid = [m for m in placed if _is_number(getattr(m, "alt", None))] or placed
    if not valid:
        raise ValueError(
            f"{path}: the NMEA file contains no valid position in sentences GGA or RMC: switch them on in the receiver"
        )
    dates = _dates(messages)
    days = [dates[id(m)] for m in valid]
    elapsed = [
        (day or timedelta())
        + timedelta(hours=m.time.hour, minutes=m.time.minute, seconds=m.time.second)
        + timedelta(microseconds=m.time.microsecond)
        for day, m in zip(days, valid, strict=True)
    ]
    whole = np.array([int(t / timedelta(microseconds=1)) for t in elapsed], "M8[us]")
    times = whole if dates["dated"] else whole.astype(np.int64) / 1e6
    columns = {
        "time": times,
        "latitude": np.array([m.lat for m in valid], float),
        "longitude": np.array([m.lon for m in valid], float),
    }
    heights, above = _heights(valid)
    columns |= heights
    notes = [
        f"{count} {what}"
        for count, what in (
            (len(fixes) - len(placed), "sentences without a valid position left out"),
            (len(placed) - len(valid), "sentences without an altitude left out"),
            (faulty, "faulty sentences left out"),
        )
        if count
    ]
    return ColumnTable(columns, "position"), (*notes, *above)


def _messages(path: Path, data: bytes) -> tuple[list[Any], int]:
    require_package("pynmeagps", f"{path}: reading NMEA files", "exchange")
    from pynmeagps import ERR_LOG, NMEAReader

    errors: list[Any] = []
    lines = b"\r\n".join(found[0].strip() for line in data.splitlines() if (found := _SENTENCE.search(line))) + b"\r\n"
    reader = NMEAReader(io.BytesIO(lines), quitonerror=ERR_LOG, errorhandler=errors.append)
    messages = [message for _, message in reader if message is not None and not isinstance(message, str)]
    return [m for m in messages if m.msgID in ("GGA", "RMC", "ZDA")], len(errors)


def _is_number(value: Any) -> bool:
    """Return whether a field of a sentence contains a number; an empty field is a text."""
    return isinstance(value, int | float)


def _is_valid(message: Any) -> bool:
    placed = isinstance(message.lat, float) and isinstance(message.lon, float) and hasattr(message.time, "hour")
    return placed and (message.quality > 0 if message.msgID == "GGA" else message.status == "A")


def _heights(messages: list[Any]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Return the column of the heights, if the messages have altitudes, and a note if they are above the geoid."""
    if not _is_number(getattr(messages[0], "alt", None)):
        return {}, ()
    altitudes = np.array([m.alt for m in messages], float)
    if not all(_is_number(m.sep) for m in messages):
        return {"height": altitudes}, ("heights above the geoid, because sentences lack its separation",)
    return {"height": altitudes + np.array([m.sep for m in messages], float)}, ()


def _dates(messages: list[Any]) -> dict[Any, Any]:
    """Return the days since 1970 of each message, by its identity; "dated" tells whether any message has a date.

    Messages with the same time of day belong together. A date counts for its own and the following messages; without a
    date, a day starts where the time of day falls by more than twelve hours.
    """
    found: dict[Any, Any] = {"dated": False}
    known = [_day(m) for m in messages]
    first = next((day for day in known if day is not None), None)
    found["dated"] = first is not None
    day, last = first or timedelta(), None
    k = 0
    while k < len(messages):
        group = [m for m in messages[k : k + 8] if m.time == messages[k].time]
        group = messages[k : k + len(group)]
        own = next((d for d in (_day(m) for m in group) if d is not None), None)
        now = _clock(group[0])
        if own is not None:
            day = own
        elif last is not None and now is not None and last - now > HALF_DAY:
            day += timedelta(days=1)
        last = now if now is not None else last
        found |= {id(m): day for m in group}
        k += len(group)
    return found


def _day(message: Any) -> timedelta | None:
    if message.msgID == "ZDA":
        try:
            return date(int(message.year), int(message.month), int(message.day)) - EPOCH
        except (TypeError, ValueError, AttributeError):
            return None
    day = getattr(message, "date", None)
    return day - EPOCH if isinstance(day, date) and not isinstance(day, datetime) else None


def _clock(message: Any) -> timedelta | None:
    t = message.time
    if not hasattr(t, "hour"):
        return None
    return timedelta(hours=t.hour, minutes=t.minute, seconds=t.second, microseconds=t.microsecond)
