"""Format the output of commands for a terminal with 80 columns: headings, tables, scenarios and file names."""

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from qtraj.foundation.number_text import decimals, digits, number
from qtraj.foundation.outcome import ResultCode

if TYPE_CHECKING:
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.design.fitting.fitted_route import FittedRoute
    from qtraj.design.proof.certificate import Finding

MAX_ROWS = 100
"""Maximum number of rows of a table of numbers; for longer tables, only the first and last rows are printed."""

ROWS = 21
"""Maximum number of instants of a motion that are printed; the files and --json contain all instants."""

VERDICTS = {"met": "green", "proved": "green", "sampled": "yellow", "active": "bold green", "no limit": ""}
"""The style of each status; other statuses are printed in bold red."""


def print_scenario(console: Console, scenario: Mapping[str, Any]) -> None:
    """Print the name, description, source and file of a scenario."""
    console.print(Text(scenario["name"] or scenario["file"], style="bold"))
    if scenario["description"]:
        console.print(Text(scenario["description"]))
    if scenario["source"]:
        console.print(Text(f"Source: {scenario['source']}"))
    console.print(Text(f"Scenario: {scenario['file']} (sha256 {scenario['sha256']})"), soft_wrap=True)


def print_purposes(console: Console, purposes: Mapping[str, str]) -> None:
    """Print the reasons for limits, one per line."""
    for name, text in purposes.items():
        console.print(Text(f"{name}: {text}"))


def print_files(console: Console, title: str, files: Sequence[str]) -> None:
    """Print a title and the names of files, one per line; print nothing if there are none."""
    if files:
        heading(console, title)
    for file in files:
        console.print(Text(file), soft_wrap=True)


def print_fit(console: Console, fitted: "Fitted | FittedRoute | None") -> None:
    """Print how well a path follows its recording; print nothing for None."""
    from qtraj.design.fitting.facts import TITLE, fact_rows, facts
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.design.fitting.route_facts import TITLE as ROUTE_TITLE, route_fact_rows

    if fitted is None:
        return
    if not isinstance(fitted, Fitted):
        print_facts(console, ROUTE_TITLE, route_fact_rows(fitted))
        return
    fit = facts(fitted)
    print_facts(console, TITLE, fact_rows(fit))
    if fit["warning"]:
        console.print(Text(f"Warning: {fit['warning']}", style="bold red"))
    elif fit["status"] != ResultCode.successful.name:
        console.print(Text(f"Note: {fit['result']}", style="yellow"))


def heading(console: Console, text: str) -> None:
    """Print an empty line and a title."""
    console.print()
    console.print(Text(text, style="bold"))


def verdict(text: str) -> Text:
    """Return a status such as 'met', 'active' or 'broken' as coloured text."""
    return Text(text, VERDICTS.get(text, "bold red"))


def plain_table(*names: str, right: tuple[str, ...] = (), last: tuple[str, ...] = ()) -> Table:
    """Return an empty table with the columns `names`, `right` and `last`; the columns `right` are right-aligned."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in (*names, *right, *last):
        # Folded on narrow terminals, so that numbers are not truncated.
        table.add_column(Text(name), justify="right" if name in right else "left", overflow="fold")
    return table


def print_facts(console: Console, title: str, rows: Iterable[tuple[str, str]]) -> None:
    """Print a title, and a table of names and their values without a header."""
    heading(console, title)
    table = plain_table("", "")
    table.show_header = False
    for name, text in rows:
        table.add_row(Text(name), Text(text))
    console.print(table)


def print_findings(
    console: Console,
    title: str,
    findings: Iterable["Finding"],
    column: str,
    cell_of: Mapping[str, str],
    digits_of_time: int,
) -> None:
    """Print the findings on limits, with one more column, named `column`, whose cells have the names of the limits."""
    heading(console, title)
    table = plain_table("limit", right=("largest", "limit", "at [s]", column), last=("",))
    for x in findings:
        cells = (number(x.value), number(x.limit), number(x.time, digits_of_time), cell_of.get(x.name, "-"))
        table.add_row(Text(x.label), *cells, verdict(x.status))
    console.print(table)


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
    title: str,
    columns: Mapping[str, Any],
    headers: Mapping[str, Sequence[str]],
    angles: Container[str],
    significant: Container[str] = (),
) -> None:
    """Print the `numbers_table` of at most `ROWS` instants, selected evenly from all instants.

    Columns in `angles` are converted from radians to degrees.
    """
    heading(console, title)
    values = {name: np.array(columns[name], dtype=float) for name in headers}
    values = {name: np.degrees(x) if name in angles else x for name, x in values.items()}
    count = len(values["time"])
    shown = np.unique(np.linspace(0, count - 1, min(ROWS, count)).round().astype(int))
    console.print(numbers_table({name: x[shown] for name, x in values.items()}, headers, {}, significant))
    if len(shown) < count:
        console.print(Text(f"{len(shown)} of {count} instants; the files and --json contain all instants"))
