"""Recognise tables of two or three columns of numbers without a header: x and y, and perhaps z."""

from pathlib import Path

from qtraj.io.track.column_names import find
from qtraj.io.track.delimited import content, is_number, names_of, row_delimiter
from qtraj.io.track.known_names import FLAT
from qtraj.io.track.lines import UTF16
from qtraj.io.track.other_formats import other_format


def columns_by_number(path: Path, data: bytes) -> list[str] | None:
    """Return the numbers of the columns, "1", "2" and perhaps "3", of a table without header, otherwise None."""
    if other_format(data) is not None or b"\0" in data[:4096]:
        return None
    found = content(path, text_of(data))
    line = found.lines[0][1]
    delimiter = row_delimiter(line)
    cells = names_of(line, delimiter)
    numbers = all(is_number(cell, delimiter != ",") for cell in cells)
    named = any(find(FLAT, names_of(text, d)) for _, text in found.comments for d in (delimiter, ",", " "))
    if not numbers or len(cells) not in (2, 3) or (named and len(cells) == 3):
        return None
    return [str(k + 1) for k in range(len(cells))]


def text_of(data: bytes) -> str:
    """Return the text of a file, or of its start, in UTF-8 or UTF-16."""
    return data.decode("utf-16" if data.startswith(UTF16) else "utf-8-sig", errors="replace")
