"""Whether a file is a recording, by its name or by what it holds."""

import re
from pathlib import Path

RECORDINGS = (".csv", ".tsv", ".tum")
"""How the names of recordings end; others, such as .txt, may be recordings by what they hold."""
FEWEST_COLUMNS = 4
"""Of a recording: a time and a position."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def is_recording(file: Path, text: str = "") -> bool:
    """Whether a file is a recording by its name, or by its text: rows of numbers, with or without a header."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    rows = bool(lines) and "=" not in lines[0] and any(map(_is_row, lines[:2]))
    return file.suffix.lower() in RECORDINGS or rows


def _is_row(line: str) -> bool:
    cells = re.split(r"[,;\s]+", line.strip())
    return len(cells) >= FEWEST_COLUMNS and all(map(NUMBER.fullmatch, cells))
