"""Recognise recordings by their name or their contents."""

import re
from pathlib import Path

RECORDINGS = (".csv", ".tsv", ".tum")
"""Suffixes of recordings; files with other suffixes, such as .txt, are recognised by their contents."""
MIN_COLUMNS = 4
"""A recording has at least a time and three coordinates."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def is_recording(file: Path, text: str = "") -> bool:
    """Whether a file is a recording by its suffix, or by its text: rows of numbers, with or without a header."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    rows = bool(lines) and "=" not in lines[0] and any(map(_is_row, lines[:2]))
    plain = file.with_suffix("") if file.suffix == ".gz" else file
    return plain.suffix.lower() in RECORDINGS or rows


def _is_row(line: str) -> bool:
    cells = re.split(r"[,;\s]+", line.strip())
    return len(cells) >= MIN_COLUMNS and all(map(NUMBER.fullmatch, cells))
