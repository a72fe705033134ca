"""Dates and times of day that consist of digits alone, such as 20260506 and 093000."""

import re
from collections.abc import Sequence

_DATE = re.compile(r"(?:19|20)\d\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])")
_OTHER_DATE = re.compile(r"\d{6}|\d{4}([-/.])\d\d?\1\d\d?|\d\d?([-/.])\d\d?\2\d{4}")
_CLOCK = re.compile(r"\d{5,6}(?:\.\d*)?")
_BOTH = re.compile(rf"{_DATE.pattern}(?:[01]\d|2[0-3])[0-5]\d[0-5]\d(?:\.\d*)?")
_WHOLE = re.compile(r"(\d+)\.0*")


def is_date(cell: str) -> bool:
    """Return whether a cell consists of year, month and day."""
    return _DATE.fullmatch(_whole(cell)) is not None


def are_date_and_clock(day: str, clock: str) -> bool:
    """Return whether two cells are a date in any form and a time of day in five or six digits.

    A time of day has five digits if its first zero was lost. Dates in six digits have no certain order, and are refused
    when they are read.
    """
    dated = is_date(day) or _OTHER_DATE.fullmatch(_whole(day)) is not None
    return dated and _CLOCK.fullmatch(clock.strip()) is not None


def is_compact(cell: str) -> bool:
    """Return whether a cell may be a date and a time of day in fourteen digits."""
    return _BOTH.fullmatch(cell.strip()) is not None


def joined(day: str, clock: str) -> str:
    """Return a date and a time of day in one text, with separators if they are digits alone."""
    return f"{_with_hyphens(_whole(day))} {_with_colons(clock.strip())}"


def all_joined(cells: Sequence[str]) -> list[str] | None:
    """Return dates with separators if every cell is a date and a time of day in fourteen digits, otherwise None."""
    plain = [cell.strip() for cell in cells]
    if not plain or not all(map(_BOTH.fullmatch, plain)):
        return None
    return [joined(cell[:8], cell[8:]) for cell in plain]


def _whole(cell: str) -> str:
    """Return the digits of a whole number, also if it is written as a number with a decimal point."""
    match = _WHOLE.fullmatch(cell.strip())
    return match[1] if match else cell.strip()


def _with_hyphens(day: str) -> str:
    return f"{day[:4]}-{day[4:6]}-{day[6:]}" if _DATE.fullmatch(day) else day


def _with_colons(clock: str) -> str:
    """Return a time of day with colons; the zeros at its start may be missing."""
    digits, point, rest = clock.partition(".")
    if not digits.isdecimal() or len(digits) > 6:
        return clock
    digits = digits.zfill(6)
    return f"{digits[:2]}:{digits[2:4]}:{digits[4:]}{point}{rest or '0' * len(point)}"
