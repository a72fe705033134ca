"""What is wrong with a text that is not TOML: where, the line itself, and what was probably forgotten."""

import re
import tomllib

LONGEST = 60
"""A longer value is quoted only so far."""
PLACE = re.compile(r"at line (\d+), column (\d+)")
BARE = re.compile(r"""([\w.-]+)\s*=\s*((?:[A-Za-z_~/]|[^\s"'\[\]{}#]*\.[A-Za-z])[^"'\[\]{}#]*?)\s*(?:\#.*)?""")
"""A key with a name, such as that of a file, but no quotes about it."""


def syntax_fault(text: str, error: tomllib.TOMLDecodeError) -> str:
    """The message of the parser with line and column, the line there, and advice where a text has no quotes."""
    lines = text.split("\n")
    message = str(error)
    place = PLACE.search(message)
    if place is None:  # an end of the file that came too early
        last = text.splitlines() or [""]
        end = f"at line {len(last)}, column {len(last[-1]) + 1}, the end of the file"
        return message.replace("at end of document", end)
    line, column = lines[int(place[1]) - 1], int(place[2]) - 1
    advice = ""
    if message.startswith(("Invalid value", "Expected newline")):
        if (bare := BARE.fullmatch(line.strip())) is not None:
            advice = f'; a text needs quotes: {bare[1]} = "{bare[2]}"'
        elif message.startswith("Invalid") and line[column : column + 1].isalpha():
            advice = "; a text needs quotes"
    return f"{message} in {quoted(line.strip())}{advice}"


def quoted(value: object) -> str:
    """A value as Python writes it, cut where it is long."""
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
