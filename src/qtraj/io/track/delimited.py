"""Find the rows, the header and the delimiter of a table in a text file."""

import csv
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from qtraj.io.track.column_names import names_columns
from qtraj.io.track.column_units import unit_of
from qtraj.io.track.lines import Lines, split_lines
from qtraj.io.track.recorded_times import CLOCK, is_time
from qtraj.io.track.text_table import TextTable, split

DELIMITERS = ",;\t "
HEADER_LINES = 100
"""Number of lines at the start of a file among which the header is sought."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_UNIT_APART = re.compile(r"\s+(?=[\[(])")


class Content(NamedTuple):
    """The lines of a file that are not blank: comments without their mark, and all others."""

    comments: list[tuple[int, str]]
    lines: Lines


def content(path: Path | str, text: str) -> Content:
    """Return the lines of a text with their numbers; `path` is the name of the file for messages.

    **Raises:** ValueError for a text without rows.
    """
    comments, lines = split_lines(text)
    if not lines:
        what = (
            "all lines are comments, which start with #, % or //: remove these marks"
            if comments
            else "the file is empty"
        )
        raise ValueError(f"{path}: {what}; a track needs rows of times and positions")
    first = min(lines[0][0], HEADER_LINES + 1)
    heads = [(k, line.lstrip().lstrip("#%/").strip()) for k, line in comments[:HEADER_LINES] if k < first]
    return Content([item for item in heads if item[1]], lines)


def is_number(cell: str, decimal_comma: bool = False) -> bool:
    """Return whether a cell is a number."""
    try:
        float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return False
    return True


def are_numbers(named: Sequence[str]) -> bool:
    """Return whether a user names the columns by their numbers, as is possible for a table without header."""
    return len(named) > 0 and all(name.isdecimal() for name in named)


def find_table(path: Path | str, found: Content, named: Sequence[str] = ()) -> TextTable:
    """Return the table of a file.

    The header is the first line that names columns of a time and a position, or all columns in `named`: a line of its
    own, or a comment with as many cells as the first row. Otherwise the header is the last line before the numbers.
    Without a header, and if `named` consists of numbers, the columns have the names 1, 2, 3, ….

    **Raises:** ValueError if the file has no header.
    """

    def is_header(cells: list[str]) -> bool:
        return names_columns(cells) or (len(named) > 0 and set(named) <= set(cells))

    return (
        _header_line(found.lines, is_header)
        or _header_in_comment(found, is_header)
        or _last_words(found.lines)
        or _header_in_comment(found, lambda _: True)
        or _by_numbers(path, found.lines, named)
    )


def header_in_comment(found: Content, named: Sequence[str] = ()) -> list[str] | None:
    """Return the names in a comment that has as many cells as the first row, otherwise None.

    The comment must name columns of a time and a position, or all columns in `named`.
    """
    table = _header_in_comment(
        found, lambda cells: names_columns(cells) or (len(named) > 0 and set(named) <= set(cells))
    )
    return None if table is None else table.header


def _header_line(lines: Lines, is_header: Callable[[list[str]], bool]) -> TextTable | None:
    for k, (_, line) in enumerate(lines[:HEADER_LINES]):
        for delimiter in _delimiters(line):
            cells = names_of(line, delimiter)
            if is_header(cells) and not all(map(is_number, cells)):
                return _table(cells, lines[k + 1 :], delimiter)
    return None


def _header_in_comment(found: Content, is_header: Callable[[list[str]], bool]) -> TextTable | None:
    if not _is_data(found.lines[0][1]):
        return None
    delimiter = row_delimiter(found.lines[0][1])
    count = len(next(split(found.lines[:1], delimiter)))
    for _, line in found.comments:
        for other in [delimiter, *DELIMITERS.replace(delimiter, "")]:
            cells = names_of(line, other)
            if len(cells) not in (count, count - _has_date_and_clock(found.lines, delimiter)) or len(cells) < 3:
                continue
            if is_header(cells) and not any(map(is_number, cells)):
                return _table(cells, found.lines, delimiter)
    return None


def _has_date_and_clock(lines: Lines, delimiter: str) -> bool:
    """Return whether the rows begin with a date and a time of day between spaces."""
    row = next(split(lines[:1], delimiter), []) if delimiter == " " else []
    return len(row) > 1 and CLOCK.fullmatch(row[1]) is not None and is_time(f"{row[0]} {row[1]}")


def _last_words(lines: Lines) -> TextTable | None:
    """Return the table whose header is the last line before the numbers, or the first line if there are no numbers."""
    if _is_data(lines[0][1]):
        return None
    data = next((k for k, (_, line) in enumerate(lines[:HEADER_LINES]) if _is_data(line)), 1)
    place = data - 1
    delimiter = _delimiters(lines[place][1])[0]
    names = names_of(lines[place][1], delimiter)
    if place and _are_units(names):
        place, names = place - 1, names_of(lines[place - 1][1], delimiter)
    return _table(names, lines[place + 1 :], delimiter)


def _by_numbers(path: Path | str, lines: Lines, named: Sequence[str]) -> TextTable:
    number, line = lines[0]
    delimiter = row_delimiter(line)
    row = next(split(lines[:1], delimiter))
    if are_numbers(named):
        return _table([str(k + 1) for k in range(len(row))], lines, delimiter)
    raise ValueError(
        f"{path}, line {number}: expected a header row with column names, but the row contains numbers "
        f"({', '.join(cell.strip()[:40] for cell in row[:8])}{', …' if len(row) > 8 else ''}): insert a line such as "
        'time,x,y,z, or name the columns by their numbers with columns={"time": "1", "position": ["2", "3", "4"]}, '
        "on the command line --columns time=1 --columns position=2,3,4"
    )


def _table(header: list[str], lines: Lines, delimiter: str) -> TextTable:
    """Return a table, without a row of units below the header; find out whether its numbers have a decimal comma."""
    units = None
    if _has_date_and_clock(lines, delimiter) and len(next(split(lines[:1], delimiter))) == len(header) + 1:
        header = ["date", "time", *header[1:]]  # one name for both
    if lines and len(row := next(split(lines[:1], delimiter))) == len(header) and _are_units(row):
        units, lines = [cell.strip(" []()") for cell in row], lines[1:]
    comma = delimiter != "," and lines.contains(",") and any(_has_comma(line, delimiter) for line in lines.texts())
    return TextTable(header, lines, delimiter, comma, units)


def _has_comma(line: str, delimiter: str) -> bool:
    """Return whether a line has a number with a decimal comma; 1,234 beside 0.5 has a separator of thousands."""
    if "," not in line:
        return False
    cells = names_of(line, delimiter)
    commas = [cell for cell in cells if _DECIMAL_COMMA.fullmatch(cell)]
    if not commas:
        return False
    points = any("." in cell and is_number(cell) for cell in cells)
    return not points or not all(map(_THOUSANDS.fullmatch, commas))


def _are_units(row: list[str]) -> bool:
    texts = [cell.strip(" []()") for cell in row]
    in_brackets = all(cell[:1] + cell[-1:] in ("()", "[]") for cell in map(str.strip, row) if cell)
    return (
        any(texts)
        and (in_brackets or all(not text or text in {"-", "1"} or unit_of(text) for text in texts))
        and not any(map(is_number, texts))
    )


def names_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without spaces around them; a unit in brackets stays with its name."""
    text = _UNIT_APART.sub("", line) if delimiter == " " else line
    try:
        return [cell.strip() for cell in next(split([(0, text)], delimiter), [])]
    except csv.Error:
        return []


def _delimiters(line: str) -> list[str]:
    """Return the delimiters in a header, the most frequent one first; the space counts if there is no other."""
    present = sorted((d for d in ",;\t" if d in line), key=lambda d: -line.count(d))
    return present or [" " if " " in line.strip() else ","]


def row_delimiter(line: str) -> str:
    """Return the delimiter of a row of numbers; a comma is decimal if another delimiter separates numbers with it."""
    best, most = ",", 1
    for delimiter in ",;\t ":
        if delimiter == " " and best in ";\t":  # spaces within cells, as in dates with times of day
            break
        cells = names_of(line, delimiter)
        understood = [is_number(cell, delimiter != ",") or is_time(cell) for cell in cells]
        words = delimiter == " " and 2 * sum(understood) < len(
            cells
        )  # such as names with numbers: channel 1, channel 2
        if len(cells) > 1 and sum(understood) > most and not words:
            best, most = delimiter, sum(understood)
    return best


def _is_data(line: str) -> bool:
    """Return whether a line is a row of numbers or times, and not of names."""
    cells = names_of(line, row_delimiter(line))
    numbers = [is_number(cell, True) or is_time(cell) for cell in cells]
    return len(cells) > 1 and sum(numbers) >= (2 if numbers[0] else 3)
