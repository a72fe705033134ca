"""Times whose year, month, day, hour, minute and second are in columns of their own."""

import itertools
from collections.abc import Sequence

PARTS = tuple(
    ",".join(names)
    for names in itertools.product(
        ("year",), ("month",), ("day",), ("hour",), ("minute", "min"), ("second", "sec", "seconds")
    )
)
"""Names of the six columns."""

LIMITS = (9999, 12, 31, 23, 59, 60)
"""Largest values of the parts; a leap second is the second 60."""


def joined_parts(parts: Sequence[str]) -> str | None:
    """Return six cells as one date and time, such as 2026-05-06 09:30:00.5, or None if they are not such parts."""
    *whole, second = (part.strip() for part in parts)
    digits, _, fraction = second.partition(".")
    numbers = [part.partition(".") for part in whole]
    if not all(number.isdecimal() and not rest.strip("0") for number, _, rest in numbers) or not digits.isdecimal():
        return None
    values = [*(int(number) for number, _, _ in numbers), int(digits)]
    if values[0] < 1000 or any(value > limit for value, limit in zip(values, LIMITS, strict=True)):
        return None
    year, month, day, hour, minute, seconds = values
    rest = f".{fraction}" if fraction else ""
    return f"{year}-{month:02d}-{day:02d} {hour:02d}:{minute:02d}:{seconds:02d}{rest}"
