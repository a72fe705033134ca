"""Format the output of commands for a terminal with 80 columns: headings, tables, scenarios and file names."""

import math
from collections.abc import Container, Mapping, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from qtraj.foundation.number_text import decimals, digits

MAX_ROWS = 100
"""Maximum number of rows of a table of numbers; for longer tables, only the first and last rows are printed."""

ROWS = 21
"""Maximum number of instants of a motion that are printed; the files and --json contain all instants."""

VERDICTS = {"met": "green", "proved": "green", "sampled": "yellow", "active": "bold green"}


def print_scenario(console: Console, scenario: dict[str, Any]) -> None:
    """Print the name, description, source and file of a scenario."""
    console.print(Text(scenario["name"] or scenario["file"], style="bold"))
    if scenario["description"]:
        console.print(Text(scenario["description"]))
    if scenario["source"]:
        console.print(Text(f"Source: {scenario['source']}"))
    console.print(Text(f"Scenario: {scenario['file']} (sha256 {scenario['sha256']})"), soft_wrap=True)


def print_files(console: Console, files: list[str]) -> None:
    """Print the names of the files that were written, one per line."""
    if files:
        heading(console, "Files written")
    for file in files:
        console.print(Text(file), soft_wrap=True)


def heading(console: Console, text: str) -> None:
    """Print an empty line and a title."""
    console.print()
    console.print(Text(text, style="bold"))


def verdict(text: str) -> Text:
    """Return a status such as 'met', 'active' or 'broken' as coloured text."""
    return Text(text, VERDICTS.get(text, "bold red"))


def number(value: float | None, digits: int = 6) -> str:
    """Return a number as text with `digits` significant digits, or a dash for None."""
    return "-" if value is None else f"{value:.{digits}g}"


def degrees(value: float | None, digits: int = 6) -> str:
    """Return an angle [rad], or a derivative of an angle, as text in degrees, or a dash for None."""
    return number(None if value is None else math.degrees(value), digits)


def plain_table(*names: str, right: tuple[str, ...] = (), last: tuple[str, ...] = ()) -> Table:
    """Return an empty table with the columns `names`, `right` and `last`; the columns `right` are right-aligned."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in (*names, *right, *last):
        # Folded on narrow terminals, so that numbers are not truncated.
        table.add_column(Text(name), justify="right" if name in right else "left", overflow="fold")
    return table


def facts_table(rows: Sequence[tuple[str, str]]) -> Table:
    """Return a table of names and their values, without a header."""
    table = plain_table("", "")
    table.show_header = False
    for name, text in rows:
        table.add_row(Text(name), Text(text))
    return table


def numbers_table(
    columns: Mapping[str, np.ndarray],
    headers: Mapping[str, Sequence[str]],
    known: Mapping[str, np.ndarray],
    significant: Container[str] = (),
) -> Table:
    """Return a table of the columns named in `headers`, each with enough decimals to distinguish its values.

    Columns have shape (n,) or (n, m), with one header for each component. A dash replaces values where `known[name]` is
    false. Columns in `significant`, which span many orders of magnitude, have four significant digits instead.
    """
    cells: list[list[str]] = []
    for name in headers:
        values = columns[name].reshape(len(columns[name]), -1).T
        here = known.get(name, np.ones(len(columns[name]), bool))
        write = digits if name in significant else decimals
        cells += [write(column, here) for column in values]
    table = plain_table(right=tuple(header for names in headers.values() for header in names))
    rows = list(zip(*cells, strict=True))
    if len(rows) > MAX_ROWS:
        rows = [*rows[: MAX_ROWS // 2], tuple("…" for _ in rows[0]), *rows[-(MAX_ROWS // 2) :]]
    for row in rows:
        table.add_row(*row)
    return table


def print_instants(
    console: Console,
    columns: Mapping[str, np.ndarray],
    headers: Mapping[str, Sequence[str]],
    significant: Container[str] = (),
) -> None:
    """Print the `numbers_table` of at most `ROWS` instants, selected evenly from all instants."""
    count = len(columns["time"])
    shown = np.unique(np.linspace(0, count - 1, min(ROWS, count)).round().astype(int))
    console.print(numbers_table({name: columns[name][shown] for name in headers}, headers, {}, significant))
    if len(shown) < count:
        console.print(Text(f"{len(shown)} of {count} instants; the files and --json contain all instants"))
