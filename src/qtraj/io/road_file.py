"""Read roads: tables of the bank and the friction by the distance along a path."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.foundation.naming import naming
from qtraj.io.track.column_names import bracketed, find
from qtraj.io.track.column_scales import unit_of_column
from qtraj.io.track.limit_columns import factor_of
from qtraj.io.track.missing_columns import listed
from qtraj.io.track.reading import checked
from qtraj.io.track.sources import Source, find_source
from qtraj.path.road import Kind, Road

DISTANCES = ("distance", "s", "station", "chainage", "arc_length")
BANKS = ("bank", "bank_angle", "banking", "superelevation_angle", "cross_slope_angle")
FRICTIONS = ("friction_along,friction_across", "mu_along,mu_across", "friction", "mu", "grip")
INVERTED = ("inverted",)
"""Names of columns, without units."""


def read_road(file: Any, kind: Kind = "linear") -> Road:
    """Read the bank and the friction of a road from a table with one row for each distance along the path.

    The columns are `distance` (or `s`), and `bank`, `friction` (or `friction_along` and `friction_across`) and
    `inverted` (0 or 1), as far as they exist. Units are in the names of the columns, such as `bank_deg` or
    `distance [km]`; without them, distances are in metres and angles in radians.

    Args:
        file: The name of a text file with a header, or a data frame of pandas or polars.
        kind: "linear" or "step", as for `Road`.

    Returns:
        The road, an argument of `Vehicle`.

    Raises:
        FileNotFoundError: For a missing file.
        ValueError: With the name of the file, for a table without distances, or without any other of these columns,
            for a cell that is not a finite number, a unit of another kind, and otherwise as `Road`.
    """
    try:
        source = find_source(file, checked())
    except FileNotFoundError:
        raise FileNotFoundError(f"{file}: there is no such file, so no road can be read") from None
    with naming(f"{source.name}: "):
        known = {name: find(names, source.table.header) for name, names in _PARTS.items()}
        if known["distance"] is None or not any(x for name, x in known.items() if name != "distance"):
            raise ValueError(
                "a road needs a column for the distance, such as 'distance', and at least one of 'bank', 'friction' "
                f"and 'inverted', but the columns are {listed(source.table.header)}"
            )
        found: dict[str, Any] = {name: _values(source, name, x) for name, x in known.items() if x is not None}
        if "inverted" in found:
            found["inverted"] = _flags(found["inverted"])
        return Road(kind=kind, **found)


_PARTS = {"distance": DISTANCES, "bank": BANKS, "friction": FRICTIONS, "inverted": INVERTED}
_KINDS = {"distance": "length", "bank": "angle"}
UNITLESS = ("", "1", "-")
"""Texts in place of the unit of a number without unit."""


def _values(source: Source, part: str, names: tuple[str, ...]) -> np.ndarray:
    """Return the columns of a part, in SI units."""
    rows = dict(zip(source.table.header, source.table.units or [], strict=False))
    kind = _KINDS.get(part)
    factors = [_factor(name, part, kind, rows) for name in names]
    values = np.array(factors) * source.table.numbers(source.name, names)
    return values[:, 0] if len(names) == 1 else values


def _factor(name: str, part: str, kind: str | None, rows: Mapping[str, str]) -> float:
    """Return the factor from the unit of a column to SI; `rows` contains the row of units by column.

    **Raises:** ValueError for a unit that is unknown or of another kind.
    """
    unit = unit_of_column(name, rows)
    unknown = [text for text in (*bracketed(name), rows.get(name, "")) if text not in UNITLESS]
    if unit is None and unknown:
        raise ValueError(f"the column {name!r} is in {unknown[0]!r}, which is not a known unit: convert it first")
    if unit is None:
        return 1.0
    if unit[1].kind != kind:
        wanted = {"length": "a length", "angle": "an angle"}.get(kind or "", "a number without unit")
        raise ValueError(f"the column {name!r} is in {unit[0]}, but the {part} of a road is {wanted}")
    return factor_of(unit[1])


def _flags(values: np.ndarray) -> np.ndarray:
    if not np.isin(values, (0, 1)).all():
        raise ValueError("the column 'inverted' must contain 0 and 1 only")
    return values == 1
