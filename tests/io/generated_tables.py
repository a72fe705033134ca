"""Tables with random forms and faults, each with the track that it must give, or the remedy that it must name."""

from typing import NamedTuple

import numpy as np
from tests.io import drive
from tests.io.generated_columns import Column, attitude_columns, pick, place_columns, renamed, time_columns, with_units

FAULT = 0.35
"""Probability of a fault."""


class Case(NamedTuple):
    """The bytes of a file, its name, the options of `read_track`, and the expected outcome.

    Either `times` (n,) from the first sample on, `positions` (n, 3) up to a translation, and the attitudes, where the
    file has them; or `words`, a pattern of the refusal. `columns`: the columns of the table, for a data frame.
    """

    data: bytes
    name: str
    options: dict
    words: str = ""
    times: np.ndarray = drive.SECONDS
    positions: np.ndarray = drive.POSITIONS
    velocities: np.ndarray | None = None
    attitudes: np.ndarray | None = None
    columns: list[Column] | None = None
    tolerance: float = 5e-3
    time_tolerance: float = 1e-6


def table(rng):
    """A table of a random form, with a random fault or none."""
    times, (places, options, _) = time_columns(rng), place_columns(rng)
    down = places[0].name == "north" or options.get("axes") == "ned"
    attitude, more = attitude_columns(rng, down) if rng.random() < 0.4 else ([], {})
    before = [*times, *places, *attitude]
    style = pick(rng, "[", "(", "_", "option", "row")
    after, units = with_units(rng, before, style)
    options = renamed(options | more, before, after) | ({"units": units} if units else {})
    after = after + [Column("battery", [f"{90 - 0.01 * k:.2f}" for k in range(drive.COUNT)])] * (rng.random() < 0.3)
    after = [after[k] for k in rng.permutation(len(after))] if rng.random() < 0.5 else after
    after, words, rows = faulty(rng, after, options)
    fast = drive.VELOCITIES if any(c.quantity == "velocity" for c in after) else None
    turned = drive.ROTATIONS.as_quat(scalar_first=True) if attitude else None
    fast, turned = (None if x is None else x[rows] for x in (fast, turned))
    data, name = written(rng, after, style)
    times, positions = drive.SECONDS[rows], drive.POSITIONS[rows]
    return Case(data, name, options, words, times - times[0], positions, fast, turned, after)


def faulty(rng, columns, options):
    """The columns with a fault, a pattern of the refusal (empty if the file is read), and the rows that are read."""
    every = np.arange(drive.COUNT)
    if rng.random() > FAULT:
        return columns, "", every
    fault = pick(rng, "twice", "jump", "gap", "text", "missing", "incomplete", "unknown", "unsorted", "restart", "few")
    k = int(rng.integers(5, drive.COUNT - 5))
    if fault == "gap":
        rows = np.delete(every, np.arange(k - 4, k))
        return taken(columns, rows), "", rows
    if fault == "few":
        return taken(columns, every[:3]), r"at least 4 (rows|samples)|needs at least 4", every
    if fault == "twice":
        return taken(columns, np.repeat(every, 2)), "", every
    if fault == "unsorted":
        return taken(columns, rng.permutation(every)), r"sort the rows|pass segment=", every
    if fault == "restart":
        rows = np.concatenate([every[:k], every[2 : drive.COUNT - 2]])
        if rng.random() < 0.5:
            options["segment"] = 2
            return taken(columns, rows), "", every[2 : drive.COUNT - 2]
        return taken(columns, rows), r"pass segment=1 \(.*, segment=2 \(", every
    if fault == "jump":
        rows = np.insert(every, k, k - 1)
        moved = [c._replace(cells=shifted(c, rows, k)) for c in columns]
        if rng.random() < 0.5:
            options["duplicates"] = "first"
            return moved, "", every
        return moved, r"duplicates='first'", every
    height = ("alt", "height", "elevation")  # without its name, the height of a geographic position is 0
    place = [
        n
        for n, c in enumerate(columns)
        if c.quantity in ("position", "globe") and not c.name.lower().startswith(height)
    ]
    n = place[int(rng.integers(len(place)))]
    column, cells = columns[n], list(columns[n].cells)
    if fault in ("text", "missing"):
        cells[k] = "lost" if fault == "text" else ""
        columns = [*columns[:n], column._replace(cells=cells), *columns[n + 1 :]]
        return columns, r"(correct|complete|fill) .* (delete|drop) (it|the row)|correct the (cell|row)", every
    new = "foo" if fault == "unknown" else f"foo{n}"
    columns = [*columns[:n], column._replace(name=new), *columns[n + 1 :]]
    return columns, r"columns=|there is no column|pass axes=|units=|units\[", every


def taken(columns, rows):
    return [c._replace(cells=[c.cells[k] for k in rows]) for c in columns]


def shifted(column, rows, k):
    """The cells of a column with a row whose position is far from the other row at its time."""
    cells = [column.cells[j] for j in rows]
    if column.quantity == "position":
        cells[k] = f"{float(cells[k]) + 5e3:.6f}"
    elif column.quantity == "globe" and float(column.cells[0]) > 0:
        cells[k] = f"{float(cells[k]) + 0.5:.9f}"
    return cells


def written(rng, columns, style):
    """The bytes of a table, with random delimiters, decimal marks, comments, header and line ends; and a name."""
    delimiter = pick(rng, ",", ";", "\t", " ")
    if delimiter == " " and any(" " in cell for c in columns for cell in [c.name, *c.cells[:1]]):
        delimiter = ";"
    comma = delimiter in (";", "\t") and rng.random() < 0.4
    rows = [
        [with_comma(c, cell) if comma else cell for c, cell in zip(columns, row, strict=True)]
        for row in zip(*(c.cells for c in columns), strict=True)
    ]
    names = [pick(rng, str, str, str.upper, str.title)(c.name) if c.quantity == "" else c.name for c in columns]
    header = [delimiter.join(names)]
    if style == "row" and any(c.unit for c in columns):
        header.append(delimiter.join(f"({c.unit})" if c.unit else "-" for c in columns))
    elif rng.random() < 0.3:
        header[0] = f"{pick(rng, '# ', '#', '% ', '//')}{header[0]}"
    if rng.random() < 0.3:
        header = [f"{pick(rng, '#', '%')} recorded by a logger", "# version 2", *header]
    lines = [*header, *(delimiter.join(row) for row in rows)]
    if rng.random() < 0.2:
        lines.insert(len(header) + min(2, len(rows)), "# a comment between rows")
    if rng.random() < 0.2:
        lines += ["", ""]
    end = pick(rng, "\n", "\n", "\r\n")
    data = (end.join(lines) + end).encode("utf-8-sig" if rng.random() < 0.2 else "utf-8")
    return data, f"log{pick(rng, '.csv', '.txt', '.dat', '.log', '')}"


def with_comma(column, cell):
    return cell.replace(".", ",") if column.quantity != "time" or cell.replace(".", "").isdecimal() else cell
