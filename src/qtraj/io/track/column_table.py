"""A table whose columns are arrays: of another library, or of a file that a library reads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class ColumnTable:
    """Columns of equal length by name, and what a row is called in messages: a "row" or a "point"."""

    columns: Mapping[str, np.ndarray]
    called: str = "row"
    units: list[str] | None = None

    @property
    def header(self) -> list[str]:
        """The names of the columns."""
        return list(self.columns)

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def require_columns(self, path: Path | str) -> None:
        """Each row has a cell in each column."""

    def place(self, index: int) -> str:
        """Return which row this is."""
        return f"{self.called} {index + 1}"

    def row(self, index: int) -> list[str]:
        """Return the cells of a row as texts; an empty list if there is no such row."""
        return [as_text(column[index]) for column in self.columns.values()] if index < self.count else []

    def texts(self, path: Path | str, name: str) -> list[str]:
        """Return the cells of a column as texts.

        **Raises:** ValueError with file, row and column for a missing cell.
        """
        cells = self.cells(path, name)
        if "" in cells:
            self._raise_missing(path, cells.index(""), name)
        return cells

    def cells(self, path: Path | str, name: str) -> list[str]:
        """Return the cells of a column as texts; a missing cell is an empty text."""
        return [as_text(value) for value in self.columns[name].tolist()]

    def numbers(self, path: Path | str, names: Sequence[str]) -> np.ndarray:
        """Return the columns as an array (rows, columns).

        **Raises:** ValueError with file, row and column for a cell that is missing or not a finite number.
        """
        return np.column_stack([self._floats(path, name) for name in names])

    def quick(self, names: Sequence[str], dtype: type = float) -> np.ndarray | None:
        """Return the columns as an array (rows, columns) of this type, or None if they have others."""
        columns = [self.columns[name] for name in names]
        kinds = "iu" if dtype is int else "iuf"
        if not all(column.dtype.kind in kinds for column in columns):
            return None
        return np.column_stack([column.astype(dtype) for column in columns])

    def _floats(self, path: Path | str, name: str) -> np.ndarray:
        column = self.columns[name]
        try:
            values = column.astype(float)
            bad = np.flatnonzero(~np.isfinite(values))
        except (ValueError, TypeError):
            values = np.zeros(0)
            bad = [k for k, value in enumerate(column.tolist()) if not _is_number(value)]
        if len(bad):
            k = int(bad[0])
            if as_text(column[k]) == "":
                self._raise_missing(path, k, name)
            raise ValueError(
                f"{path}, {self.place(k)}: column {name!r} must have finite numbers, but contains "
                f"{as_text(column[k])!r}: correct the cell, or drop the row"
            )
        return values

    def _raise_missing(self, path: Path | str, index: int, name: str) -> None:
        raise ValueError(
            f"{path}, {self.place(index)}: the cell of column {name!r} is missing: fill it, or drop the row"
        )


def as_text(value: object) -> str:
    """Return a cell as a text; an empty text for a missing value."""
    if value is None or value != value or str(value) in ("NaT", "<NA>"):
        return ""
    return str(value)


def _is_number(value: object) -> bool:
    try:
        return bool(np.isfinite(float(value)))  # pyright: ignore[reportArgumentType]
    except (ValueError, TypeError):
        return False
