"""Read limits that a recording contains: columns such as the speed limit at each sample."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.foundation.suggestion import suggestion
from qtraj.io.track.column_names import bracketed, plain, squeezed
from qtraj.io.track.column_scales import is_wrong, meant, unit_of_column
from qtraj.io.track.column_units import Unit, spelled, unit_of
from qtraj.io.track.time_column import Table
from qtraj.path.quantity import quantity

KINDS = {"m s-1": "speed", "rad s-1": "angular rate", "rad": "angle"}
"""The kinds of the units of columns to which limits are converted; other limits must be in SI units."""


class LimitColumn(NamedTuple):
    """The column of a limit, and its unit; by default, the unit in the name of the column, otherwise the SI unit."""

    column: str
    unit: str | None = None


class LimitSamples(NamedTuple):
    """The values of a limit, NaN where there is none, at `times` [s] on the clock of the recording."""

    times: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    column: str
    unit: str

    def text(self, limit: str) -> str:
        """Return what was read, as text."""
        return f"limit on {limit}: {self.column}, {self.unit}"


def limit_samples(
    path: Path | str, table: Table, times: Float[np.ndarray, " rows"], rows: slice, wanted: Mapping[str, LimitColumn]
) -> dict[str, LimitSamples]:
    """Return the limits in the chosen rows of a table, by the names of the limits.

    **Raises:** ValueError with the file for a missing column, a unit of another kind, and a cell that is neither empty
    nor a positive number.
    """
    units = dict(zip(table.header, table.units or [], strict=False))
    found = {}
    for limit, (name, unit) in wanted.items():
        column = _column(path, table, limit, name)
        try:
            symbol, factor = _unit(column, unit, limit, units)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        cells = table.cells(path, column)
        values = factor * np.array(
            [_number(path, table, column, k, cells[k]) for k in range(*rows.indices(len(cells)))]
        )
        found[limit] = LimitSamples(times[rows], values, column, symbol)
    return found


def _column(path: Path | str, table: Table, limit: str, name: str) -> str:
    if name in table.header:
        return name
    if (found := plain(table.header).get(squeezed(name))) is not None:
        return found
    raise ValueError(
        f"{path}: there is no column {name!r} for the limit {limit}; {suggestion(name, table.header, 'columns')}"
    )


def _unit(column: str, given: str | None, limit: str, units: Mapping[str, str]) -> tuple[str, float]:
    """Return the symbol of the unit of a column, and the factor that converts its values to SI units."""
    entry = quantity(limit)
    kind = KINDS.get(entry.unit)
    item = None if (text := given) is not None else meant(unit_of_column(column, units), kind or "none")
    if item is None:
        text = given or next((x for x in bracketed(column) if not x.isdecimal()), entry.label)
        unit = unit_of(text)
        if _plain(text) == _plain(entry.label):
            return entry.label, 1.0
    else:
        text, unit = item
        if unit.kind != kind and not is_wrong(column, text):
            return entry.label, 1.0  # a single letter at the end of a name is no unit
    if unit is None or unit.kind != kind:
        raise ValueError(
            f"the column {column!r} is in {text}, but the limit {limit} must be in {entry.label}"
            f"{'' if kind is None else f' or in another unit of this kind ({kind})'}: convert it first"
        )
    return unit.symbol, factor_of(unit)


def factor_of(unit: Unit) -> float:
    """Return the factor that converts values in a unit to SI units."""
    return float(unit.factor) * (math.pi / 180 if unit.kind == "angle" else 1.0)


def _plain(text: str) -> str:
    return spelled(text).replace("²", "2").replace("³", "3")


def _number(path: Path | str, table: Table, column: str, index: int, cell: str) -> float:
    """Return the value of a cell, or NaN for an empty one."""
    text = cell.strip()
    try:
        value = math.nan if text.lower() in ("", "nan") else float(text)
    except ValueError:
        value = -math.inf
    if value <= 0 or value == math.inf:
        raise ValueError(
            f"{path}, {table.place(index)}: the column {column!r} of a limit must have positive finite numbers, or "
            f"empty cells where there is no limit, but contains {text!r}"
        )
    return value
