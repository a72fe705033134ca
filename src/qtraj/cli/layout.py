"""Format the output of commands for a terminal with 80 columns: headings, tables, scenarios and file names.

A command returns its output as a sequence of parts, which `show` prints.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from qtraj.cli.track_options import as_options
from qtraj.foundation.number_text import decimals, digits

if TYPE_CHECKING:
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.design.fitting.fitted_route import FittedRoute
    from qtraj.io.shape.shape_file import ShapeRead
    from qtraj.io.track.reading import Recording as ReadTrack

Part = RenderableType | None
"""A part of the output; strings do not contain markup, and None and empty strings are omitted."""

MAX_ROWS = 100
"""Maximum number of rows of a table of numbers; for longer tables, only the first and last rows are printed."""

ROWS = 21
"""Maximum number of instants of a motion that are printed; the files and --json contain all instants."""

TITLE, ALERT, NOTE = "bold", "bold red", "yellow"
"""The styles of titles, of warnings that a result may be wrong, and of notes."""

VERDICTS = {"met": "green", "proved": "green", "sampled": "yellow", "active": "bold green", "no limit": ""}
"""The style of each status; other statuses are printed as `ALERT`."""


def show(console: Console, parts: Iterable[Part]) -> None:
    """Print the parts of an output, one below the other."""
    for part in parts:
        if part:
            console.print(Text(part) if isinstance(part, str) else part)


def print_scenario(console: Console, scenario: Mapping[str, Any]) -> None:
    """Print the name, description, source and file of a scenario."""
    source = scenario["source"] and f"Source: {scenario['source']}"
    show(console, [styled(scenario["name"] or scenario["file"], TITLE), scenario["description"], source])
    console.print(Text(f"Scenario: {scenario['file']} (sha256 {scenario['sha256']})"), soft_wrap=True)


def print_files(console: Console, title: str, files: Sequence[str]) -> None:
    """Print a title and the names of files, one per line; print nothing if there are none."""
    if files:
        console.print(heading(title))
    for file in files:
        console.print(Text(file), soft_wrap=True)


def styled(text: str | None, style: str) -> Text:
    """Return a text in one of the styles `TITLE`, `ALERT` and `NOTE`; None becomes an empty text."""
    return Text(text or "", style)


def heading(text: str) -> Group:
    """Return an empty line and a title."""
    return Group(Text(), styled(text, TITLE))


def facts(title: str, rows: Iterable[tuple[str, str]]) -> Group:
    """Return a title, and a table of names and their values without a header."""
    table = plain_table("", "")
    table.show_header = False
    for row in rows:
        table.add_row(*map(Text, row))
    return Group(heading(title), table)


def recording(read: "ReadTrack | None") -> list[Part]:
    """Return what was read from a recording and what is odd in it; return an empty list for None."""
    if read is None:
        return []
    return [heading("Recording"), *read.facts, *(styled(f"Note: {as_options(note)}", NOTE) for note in read.notes)]


def line(read: "ShapeRead | None") -> list[Part]:
    """Return what was read from a curve without times, and what is odd in it; return an empty list for None."""
    if read is None:
        return []
    return [heading("Shape"), *read.facts, *(styled(f"Note: {note}", NOTE) for note in read.notes)]


def fit(fitted: "Fitted | FittedRoute | None", more: Iterable[tuple[str, str]] = ()) -> list[Part]:
    """Return the quality of a fit as text, with `more` rows; return an empty list for None."""
    from qtraj.design.fitting.route_facts import fit_rows  # imported here, because it delays --help

    if fitted is None:
        return []
    title, rows, text = fit_rows(fitted)
    return [facts(title, [*rows, *more]), styled(text, ALERT if text.startswith("Warning") else NOTE)]


def grouped_table(
    title: str,
    groups: Iterable[Iterable[Sequence[str]]],
    *names: str,
    right: tuple[str, ...],
    last: tuple[str, ...] = ("",),
) -> Group:
    """Return a title and a table with one section for each group of rows.

    If the last column has no name, its cells are styled as statuses.
    """
    table = plain_table(*names, right=right, last=last)
    for group in groups:
        table.add_section()
        for *cells, end in group:
            table.add_row(*map(Text, cells), Text(end, "" if last[-1] else VERDICTS.get(end, ALERT)))
    return Group(heading(title), table)


def limits(title: str, rows: Iterable[Sequence[str]], column: str) -> Group:
    """Return a title and a table of the findings on limits: the worst values, and a last column `column`."""
    return grouped_table(title, [rows], "limit", right=("value", "limit", "at [s]", column))


def plain_table(*names: str, right: tuple[str, ...] = (), last: tuple[str, ...] = ()) -> Table:
    """Return an empty table with the columns `names`, `right` and `last`; the columns `right` are right-aligned."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in (*names, *right, *last):
        # Folded on narrow terminals, so that numbers are not truncated.
        table.add_column(Text(name), justify="right" if name in right else "left", overflow="fold")
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


def instants(
    title: str,
    columns: Mapping[str, Any],
    units: Mapping[str, str],
    headers: Mapping[str, Sequence[str]],
    significant: Container[str] = (),
) -> list[Part]:
    """Return a title and the `numbers_table` of at most `ROWS` instants, selected evenly; angles are in degrees."""
    values = {name: np.array(columns[name], dtype=float) for name in headers}
    values = {name: np.degrees(x) if units.get(name, "").startswith("rad") else x for name, x in values.items()}
    count = len(values["time"])
    shown = np.unique(np.linspace(0, count - 1, min(ROWS, count)).round().astype(int))
    table = numbers_table({name: x[shown] for name, x in values.items()}, headers, {}, significant)
    omitted = (
        f"{len(shown)} of {count} instants; the files and --json contain all instants" if len(shown) < count else ""
    )
    return [heading(title), table, omitted]
