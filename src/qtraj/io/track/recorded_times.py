"""Read recorded times: numbers in a unit, Unix times, ISO 8601 and dates, in seconds and without loss of digits."""

import re
from collections.abc import Sequence
from datetime import UTC, date, datetime
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from qtraj.io.track.column_units import SPELLINGS, Unit, unit_of

SECONDS = SPELLINGS["s"]
UNIX = (10**9, 5 * 10**9)
"""Unix times [s] from the year 2001 to the year 2128."""

LARGEST = 10**25
"""Maximum size of a number that is converted without loss of digits."""

CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d+))?")
CLOCK_FORM, DATE_FORMS = "times such as 09:00:00", "dates such as 2026-05-06T09:00:00 or 06/05/2026 09:00:00"
HOUR, DAY = 3600 * 10**9, 86400 * 10**9
"""[ns]"""

_NUMERIC_DATE = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4})(.*)")
_TWELVE_HOURS = re.compile(r"(.*?)(\d{1,2})(:\d{2}(?::\d{2}(?:[.,]\d+)?)?)\s*([AaPp])\.?[Mm]\.?")
_PLAIN_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?(Z|\+00:00)?")
_WITH_UNIT = re.compile(r"(\S*\d\.?)\s*([A-Za-z]+)")
_DIGITS = re.compile(r"[\d:.T -]*")
SHORTEST = 19
"""Number of characters of a date and a time with seconds."""

_FRACTION = re.compile(r"(.*:\d\d)[.,](\d+)(.*)")


class Times(NamedTuple):
    """Times (n,) [s], and what they were read as: `unit`, the subtracted first time as written, and a note."""

    seconds: np.ndarray
    unit: str
    origin: str | None = None
    note: str = ""


class NotATimeError(ValueError):
    """A cell that is not a time; `index` is its number."""

    def __init__(self, index: int, message: str):
        super().__init__(message)
        self.index = index


def is_time(cell: str) -> bool:
    """Return whether a cell is a date or a time of day."""
    cell = in_24_hours(cell.strip())
    return bool(CLOCK.fullmatch(cell) or _NUMERIC_DATE.fullmatch(cell) or _iso(cell) is not None)


def in_24_hours(cell: str) -> str:
    """Return a time of day or a date with AM or PM at its end in the 24-hour form; other cells unchanged."""
    match = _TWELVE_HOURS.fullmatch(cell) if cell.endswith(("M", "m", ".")) else None
    if not match or not 1 <= int(match[2]) <= 12:
        return cell
    hour = int(match[2]) % 12 + (12 if match[4].lower() == "p" else 0)
    seconds = "" if match[3].count(":") > 1 else ":00"
    return f"{match[1]}{hour:02d}{match[3]}{seconds}"


def read_times(cells: Sequence[str], unit: Unit | None = None) -> Times:
    """Return the times of the cells, in numbers with the unit `unit`, or as dates.

    Without a unit, numbers are seconds, or Unix times in s, ms, µs or ns by their size. The first time is subtracted,
    with all its digits, from dates and from Unix times in ms, µs and ns. Other times stay on their own clock.

    **Raises:** NotATimeError for a cell that is not a time.
    """
    if is_time(cells[0]):
        return _dates([in_24_hours(cell.strip()) for cell in cells])
    cells, written = _without_unit(cells)
    unit = written or unit or unit_by_size(cells[0])
    if unit == SECONDS:
        return Times(np.array([_float(k, cell) for k, cell in enumerate(cells)]), "s")
    exact = [_exact(k, cell) for k, cell in enumerate(cells)]
    factor = Fraction(unit.factor)
    unix = UNIX[0] <= abs(exact[0]) * factor.numerator / factor.denominator
    first = exact[0] if unix else 0
    scaled = np.array([float((value - first) * factor.numerator) for value in exact]) / factor.denominator
    return Times(scaled, unit.symbol, f"{cells[0].strip()} {unit.symbol}" if unix else None)


def _without_unit(cells: Sequence[str]) -> tuple[Sequence[str], Unit | None]:
    """Return numbers without the unit of time behind each of them, such as `0.1 sec` of MATLAB, and the unit."""
    match = _WITH_UNIT.fullmatch(cells[0].strip())
    unit = unit_of(match[2]) if match else None
    if match is None or unit is None or unit.kind != "time" or not all(c.rstrip().endswith(match[2]) for c in cells):
        return cells, None
    return [cell.strip().removesuffix(match[2]) for cell in cells], unit


def from_integers(values: np.ndarray, unit: Unit) -> Times:
    """Return times of whole numbers (n,) in `unit`; a Unix time is subtracted before the conversion to floats."""
    factor = Fraction(unit.factor)
    unix = UNIX[0] <= abs(int(values[0])) * factor.numerator / factor.denominator
    rest = values - values[0] if unix else values
    seconds = rest * factor.numerator / factor.denominator
    return Times(seconds, unit.symbol, f"{values[0]} {unit.symbol}" if unix else None)


def unit_by_size(cell: str) -> Unit:
    """Return the unit in which a number is a Unix time, otherwise seconds."""
    try:
        size = abs(float(cell))
    except ValueError:
        return SECONDS
    for spelling in ("ms", "us", "ns"):
        if UNIX[0] <= size * float(SPELLINGS[spelling].factor) < UNIX[1]:
            return SPELLINGS[spelling]
    return SECONDS


def _float(index: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise NotATimeError(index, "must have finite numbers") from None
    if not np.isfinite(value):
        raise NotATimeError(index, "must have finite numbers")
    return value


def _exact(index: int, cell: str) -> int | Decimal:
    try:
        value = Decimal(cell.strip())
    except InvalidOperation:
        raise NotATimeError(index, "must have finite numbers") from None
    if not value.is_finite() or abs(value) > LARGEST:
        raise NotATimeError(index, "must have finite numbers")
    return int(value) if value == value.to_integral_value() else value


def _quick_dates(cells: list[str]) -> np.ndarray | None:
    """Return dates of one form, such as 2026-05-06T09:00:00.5Z, in nanoseconds since 1970, or None for other forms."""
    if not _PLAIN_DATE.fullmatch(cells[0]):
        return None
    end = next((end for end in ("Z", "+00:00") if cells[0].endswith(end)), "")
    plain = [cell.removesuffix(end) for cell in cells]
    joined = "".join(plain)
    if min(map(len, plain)) < SHORTEST or joined.count("-") != 2 * len(plain) or not _DIGITS.fullmatch(joined):
        return None
    try:
        return np.array(plain, "M8[ns]").astype(np.int64)
    except ValueError:
        return None


def _dates(cells: list[str]) -> Times:
    quick = _quick_dates(cells)
    if quick is not None:
        return Times((quick - quick[0]) / 10**9, "date and time", cells[0])
    clock = CLOCK.fullmatch(cells[0]) is not None
    month_first, note = (False, "") if clock else _date_order(cells)
    nanoseconds = []
    for k, cell in enumerate(cells):
        value = _of_day(cell) if clock else _iso(_year_first(cell, month_first))
        if value is None:
            form = (
                "times of day such as 09:00:00" if clock else "dates such as 2026-05-06T09:00:00 or 06/05/2026 09:00:00"
            )
            raise NotATimeError(k, f"must have {form}")
        nanoseconds.append(value + _midnights(nanoseconds, value) if clock else value)
    first = nanoseconds[0]
    seconds = np.array([value - first for value in nanoseconds], float) / 10**9
    return Times(seconds, "time of day" if clock else "date and time", cells[0], note)


def _midnights(before: list[int], value: int) -> int:
    """Return the whole days to add to a time of day; a day starts between the last and the first hour of a clock."""
    if not before:
        return 0
    days, last = divmod(before[-1], DAY)
    return DAY * (days + (last >= DAY - HOUR and value < HOUR))


def _date_order(cells: list[str]) -> tuple[bool, str]:
    """Return whether the month comes before the day in numeric dates, and a note about the order."""
    parts = [match for match in map(_NUMERIC_DATE.fullmatch, cells) if match]
    if not parts:
        return False, ""
    if any(int(match[3]) > 12 for match in parts):
        return True, "month before day"
    if any(int(match[1]) > 12 for match in parts):
        return False, "day before month"
    return False, "read with the day before the month"


def _year_first(cell: str, month_first: bool) -> str:
    match = _NUMERIC_DATE.fullmatch(cell)
    if not match:
        return cell
    day, month = (match[3], match[1]) if month_first else (match[1], match[3])
    clock = re.sub(r"^[ T](\d):", r" 0\1:", match[5])
    return f"{match[4]}-{int(month):02d}-{int(day):02d}{clock}"


def _of_day(cell: str) -> int | None:
    """Return a time of day in nanoseconds since midnight, or None."""
    match = CLOCK.fullmatch(cell)
    if not match:
        return None
    hours, minutes, seconds = (int(part or 0) for part in match.groups()[:3])
    return (3600 * hours + 60 * minutes + seconds) * 10**9 + _digits(match[4] or "")


def _iso(cell: str) -> int | None:
    """Return a date and time in ISO 8601 in nanoseconds since 1970, UTC if it has no offset, or None."""
    if not re.match(r"\d{4}[-/]\d", cell) and not re.match(r"\d{8}T\d", cell):
        return None
    match = _FRACTION.fullmatch(cell)
    whole, digits = (match[1] + match[3], match[2]) if match else (cell, "")
    try:
        instant = datetime.fromisoformat(whole.replace("/", "-").removesuffix(" UTC"))
    except ValueError:
        return None
    instant = instant if instant.tzinfo else instant.replace(tzinfo=UTC)
    elapsed = instant - datetime.combine(date(1970, 1, 1), datetime.min.time(), UTC)
    return (elapsed.days * 86400 + elapsed.seconds) * 10**9 + _digits(digits)


def _digits(text: str) -> int:
    """Return the nanoseconds of the digits after the decimal point."""
    return int(text[:9].ljust(9, "0"))
