"""Explain syntax errors in TOML with the position, the line and the probable cause."""

import re
import tomllib

LONGEST = 60
"""Maximum number of characters of a quoted value; a longer value is truncated."""
PLACE = re.compile(r"at line (\d+), column (\d+)")
BARE = re.compile(r"""([\w.-]+)\s*=\s*((?:[A-Za-z_~/]|[^\s"'\[\]{}#]*\.[A-Za-z])[^"'\[\]{}#]*?)\s*(?:\#.*)?""")
"""Pattern of a key whose value is a string without quotes, such as a file name."""


def syntax_fault(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Return the parser's message with the position, followed by the line and, if a string lacks quotes, by advice.

    If the file ends too early, the message contains only the position of the end.
    """
    lines = text.split("\n")
    message = str(error)
    place = PLACE.search(message)
    if place is None:  # the parser gives no position if the file ends too early
        last = text.splitlines() or [""]
        end = f"at line {len(last)}, column {len(last[-1]) + 1}, the end of the file"
        return message.replace("at end of document", end)
    line, column = lines[int(place[1]) - 1], int(place[2]) - 1
    advice = ""
    if message.startswith(("Invalid value", "Expected newline")):
        if (bare := BARE.fullmatch(line.strip())) is not None:
            advice = f'; a string needs quotes: {bare[1]} = "{bare[2]}"'
        elif message.startswith("Invalid") and line[column : column + 1].isalpha():
            advice = "; a string needs quotes"
    return f"{message} in {quoted(line.strip())}{advice}"


def quoted(value: object) -> str:
    """Return the `repr` of a value, truncated to `LONGEST` characters."""
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
