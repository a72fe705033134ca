"""Recognise recordings by their file names or contents."""

import re
from pathlib import Path

RECORDINGS = (".csv", ".tsv", ".tum")
"""Suffixes of recordings; files with other suffixes, such as .txt, are recognised by their contents."""
MIN_COLUMNS = 4
"""Minimum number of columns of a recording: time and three coordinates."""
HEADER_LINES = 10
COMMENTS = ("#", "%", "//")
_NOT_NAMES = re.compile(r"=|^\s*\[|\{")
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def is_recording(file: Path, text: str = "") -> bool:
    """Return whether the suffix of a file, or a row of numbers at the start of its `text`, indicates a recording.

    The row may follow up to `HEADER_LINES` lines of names.
    """
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(COMMENTS)]
    first = next((k for k, line in enumerate(lines[: HEADER_LINES + 1]) if _is_row(line)), None)
    rows = first is not None and not any(_NOT_NAMES.search(line) for line in lines[:first])
    plain = file.with_suffix("") if file.suffix == ".gz" else file
    return plain.suffix.lower() in RECORDINGS or rows


def _is_row(line: str) -> bool:
    cells = re.split(r"[,;\s]+", line.strip())
    return len(cells) >= MIN_COLUMNS and all(map(NUMBER.fullmatch, cells))
