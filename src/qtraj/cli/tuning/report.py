"""The outcome of a tuning on the terminal, readable at 80 columns."""

import math
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from qtraj.cli.layout import facts_table, heading, number, plain_table, print_files, print_scenario, verdict
from qtraj.cli.tuning.remarks import bounds_text, fixed_text, moved_text
from qtraj.design.fitting.facts import TITLE, fact_rows
from qtraj.foundation.outcome import ResultCode

COMPONENTS = {"V_rho": "V_ρ", "V_phi": "V_φ", "V_h": "V_h"}
ENDS = {"start": "A", "end": "B"}


def print_tuning(console: Console, content: dict[str, Any]) -> None:
    """The whole outcome, from the scenario to the files written."""
    print_scenario(console, content["scenario"])
    if content["fit"] is not None:
        print_fit(console, content["fit"])
    _print_limits(console, content["limits"])
    _print_boundary(console, content["boundary"])
    if content["departure"] is not None:
        console.print(Text(f"The path after leaves the path before by {content['departure']:.3g} m at most."))
        console.print(Text(moved_text(content["change"])))
    tuning = content["tuning"]
    heading(console, f"Result: objective '{tuning['objective']}', motion '{tuning['motion']}'")
    for what, text in (("Fixed", fixed_text(tuning)), ("Bounded", bounds_text(tuning))):
        if text:
            console.print(Text(f"{what}: {text}."))
    console.print(Text(tuning["result"]))
    if content["warning"]:
        console.print(Text(content["warning"], style="yellow"))
    print_files(console, content["files"])


def print_fit(console: Console, fit: dict[str, Any]) -> None:
    """The fitted spiral-helix against its recording."""
    heading(console, TITLE)
    console.print(facts_table(fact_rows(fit)))
    if fit["warning"]:
        console.print(Text(f"Warning: {fit['warning']}", style="bold red"))
    elif fit["status"] != ResultCode.successful.name:
        console.print(Text(f"Note: {fit['result']}", style="yellow"))


def _print_limits(console: Console, limits: dict[str, dict[str, Any]]) -> None:
    heading(console, "Limits before and after")
    table = plain_table("limit", "path", right=("value", "limit", "margin", "at [s]"), last=("",))
    for name, entry in limits.items():
        unit = f"[{entry['unit'] or '-'}]"
        for label, when in ((name, "before"), (unit, "after")):
            found = entry[when]
            numbers = (number(found["value"]), number(entry["limit"]), _margin(found))
            table.add_row(Text(label), when, *numbers, number(found["time"], 4), verdict(found["status"]))
        table.add_section()
    console.print(table)
    for name, entry in limits.items():
        if entry["purpose"]:
            console.print(Text(f"{name}: {entry['purpose']}"))


def _print_boundary(console: Console, boundary: dict[str, Any]) -> None:
    heading(console, "Boundary velocities before and after")
    before, after = boundary["before"], boundary["after"]
    table = plain_table("", right=("before", "after", "change"), last=("unit",))
    for end, letter in ENDS.items():
        for name, symbol in COMPONENTS.items():
            _compare(table, f"{symbol} at {letter}", before[end][name], after[end][name], "m/s")
    table.add_section()
    _compare(table, "duration", before["duration"], after["duration"], "s")
    _compare(table, "mean rate", before["mean_rate"], after["mean_rate"], "rad/s")
    _compare(table, "length", before["length"], after["length"], "m")
    console.print(table)
    console.print(Text("A: start, B: end. V_ρ: away from the axis, V_φ: about it, V_h: along it."))
    given = [boundary["given"][end][name] for end in ENDS for name in COMPONENTS]
    used = [before[end][name] for end in ENDS for name in COMPONENTS]
    if not all(math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-6) for a, b in zip(given, used, strict=True)):
        start, end = (", ".join(f"{v:.4f}" for v in boundary["given"][e].values()) for e in ENDS)
        console.print(Text(f"Given were (V_ρ, V_φ, V_h) = ({start}) m/s at A and ({end}) m/s at B."))


def _compare(table: Table, label: str, before: float, after: float, unit: str) -> None:
    was, now, change = (round(x, 4) + 0.0 for x in (before, after, after - before))  # no -0.0000
    table.add_row(Text(label), f"{was:.4f}", f"{now:.4f}", f"{change:+.4f}", Text(unit))


def _margin(found: dict[str, Any]) -> str:
    if found["binding"]:
        return "binds"
    return "-" if found["margin"] is None else f"{found['margin']:+.3g}"
