"""The table of a text file: its columns as numbers, or as the texts of their cells."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qtraj.io.track.lines import Lines


@dataclass(frozen=True)
class TextTable:
    """Rows of a table: the column names, the lines with their numbers in the file, and how a line is split."""

    header: list[str]
    lines: Lines
    delimiter: str
    decimal_comma: bool = False
    units: list[str] | None = None

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self.lines)

    def place(self, index: int) -> str:
        """Return where a row is in the file."""
        return f"line {self.lines[index][0]}"

    def row(self, index: int) -> list[str]:
        """Return the cells of a row."""
        return next(split(self.lines[index : index + 1], self.delimiter), [])

    def number(self, cell: str) -> str:
        """Return a cell with a decimal point."""
        return cell.replace(",", ".") if self.decimal_comma else cell

    def texts(self, path: Path | str, name: str) -> list[str]:
        """Return the cells of a column.

        **Raises:** ValueError with file, line and column for a missing cell.
        """
        cells = self.cells(path, name)
        if not all(cells):
            self._raise_fault(path, [name], numbers=False)
        return cells

    def cells(self, path: Path | str, name: str) -> list[str]:
        """Return the cells of a column; a missing cell is an empty text.

        **Raises:** ValueError with the file for a quoted cell that spans several lines.
        """
        place = self.header.index(name)
        try:
            rows = split(self.lines, self.delimiter)
            cells = [self.number(row[place]) if place < len(row) else "" for row in rows]
        except csv.Error:
            cells = []
        if len(cells) != self.count:
            self._raise_fault(path, [], numbers=False)
        return cells

    def numbers(self, path: Path | str, names: Sequence[str]) -> np.ndarray:
        """Return the columns as an array (rows, columns).

        **Raises:** ValueError with file, line and column for a cell that is missing or not a finite number.
        """
        numbers = self.quick(names)
        numbers = self._slow(names) if numbers is None else numbers
        if numbers is None or not np.isfinite(numbers).all():
            self._raise_fault(path, names)
        return numbers  # pyright: ignore[reportReturnType]

    def quick(self, names: Sequence[str], dtype: type = float) -> np.ndarray | None:
        """Return the columns as an array (rows, columns), read by NumPy, or None if they are not as simple."""
        places = [self.header.index(name) for name in names]
        lines = self.lines.texts()
        lines = (self.number(line) for line in lines) if self.decimal_comma else lines
        spaces = self.delimiter == " "  # then a missing cell moves the others, so all cells are read
        delimiter, chosen = (None, None) if spaces else (self.delimiter, places)
        try:
            found = np.loadtxt(lines, dtype, comments=None, delimiter=delimiter, usecols=chosen, ndmin=2, quotechar='"')
        except (ValueError, OverflowError):
            return None
        if len(found) != self.count or (spaces and found.shape[1] != len(self.header)):
            return None
        return found[:, places] if spaces else found

    def require_columns(self, path: Path | str) -> None:
        """Raise a ValueError for a row with more cells than columns, as with decimal commas between commas.

        One empty cell at the end is allowed. Between spaces, a row must have as many cells as columns.
        """
        width, spaces = len(self.header), self.delimiter == " "
        if spaces or self.lines.contains('"'):
            counts = np.array([len(row) for row in split(self.lines, self.delimiter)])
        else:
            counts = self.lines.counts(self.delimiter) + 1
        wrong = np.flatnonzero((counts != width) if spaces else (counts > width))
        for k in wrong.tolist():
            row = self.row(k)
            if spaces or len(row) > width + 1 or row[-1].strip():
                cells = f"{len(row)} cell{'s' if len(row) > 1 else ''}"
                raise ValueError(
                    f"{path}, {self.place(k)}: the row has {cells}, but there are {width} columns "
                    f"({', '.join(self.header[:8])}{', …' if width > 8 else ''}): correct the row, or delete it; "
                    "numbers with decimal commas need another delimiter than the comma"
                )

    def _slow(self, names: Sequence[str]) -> np.ndarray | None:
        places = [self.header.index(name) for name in names]
        try:
            rows = [[float(self.number(row[k])) for k in places] for row in split(self.lines, self.delimiter)]
        except (ValueError, IndexError, csv.Error):
            return None
        return np.array(rows) if len(rows) == self.count else None

    def _raise_fault(self, path: Path | str, names: Sequence[str], numbers: bool = True) -> None:
        for index, (line, _) in enumerate(self.lines):
            row = self.row(index)
            for name in names:
                place = self.header.index(name)
                cell = row[place].strip() if place < len(row) else ""
                if not cell:
                    raise ValueError(
                        f"{path}, line {line}: the cell of column {name!r} is missing: complete the row, or delete it"
                    )
                if numbers and not _is_finite(self.number(cell)):
                    raise ValueError(
                        f"{path}, line {line}: column {name!r} must have finite numbers, but contains {cell!r}: "
                        "correct the cell, or delete the row"
                    )
        raise ValueError(f"{path}: a quoted cell spans several lines, but each row must be on one line")


def split(lines: Iterable[tuple[int, str]], delimiter: str) -> Iterator[list[str]]:
    """Return the cells of each line; any number of spaces separates cells if the delimiter is a space."""
    texts = (" ".join(line.split()) if delimiter == " " else line for _, line in lines)
    return csv.reader(texts, delimiter=delimiter, skipinitialspace=True)


def _is_finite(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
