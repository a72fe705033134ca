"""Replace the control characters of texts from the input, which would control a terminal or have no glyph."""

import re

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Control characters, except tab and line feed, and characters that change the direction of text."""


def has_control(text: str) -> bool:
    """Return whether a text contains control characters."""
    return _CONTROL.search(text) is not None


def printable(text: str) -> str:
    """Replace control characters by escape sequences of Python."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def one_line(text: str, longest: int) -> str:
    """Return a text in one line without control characters, with at most `longest` characters."""
    line = " ".join(part.strip() for part in printable(text).split("\n") if part.strip())
    return line if len(line) <= longest else line[: longest - 1] + "…"
