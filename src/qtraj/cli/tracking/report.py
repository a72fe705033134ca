"""The outcome of `qtraj track` on the terminal, in degrees, readable at 80 columns."""

import math
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from qtraj.cli.layout import facts_table, heading, number, numbers_table, print_files, print_scenario

ROWS = 21
"""Of the motion on the terminal; the files and --json hold all instants."""

HEADERS = {
    "time": ["t"],
    "angle": ["error"],
    "closed_form_angle": ["closed form"],
    "rate": ["ω1", "ω2", "ω3"],
    "command": ["command"],
    "norm": ["|λ|"],
}


def print_track(console: Console, content: dict[str, Any]) -> None:
    """The whole outcome, from the scenario to the files written."""
    print_scenario(console, content["scenario"])
    heading(console, "Closed loop")
    console.print(facts_table(_loop(content)))
    heading(console, "Motion")
    console.print(facts_table(_motion(content)))
    _print_columns(console, content)
    heading(console, "Result")
    console.print(Text(content["result"]))
    print_files(console, content["files"])


def _loop(content: dict[str, Any]) -> list[tuple[str, str]]:
    law, start, program = content["law"], content["start"], content["program"]
    gains = ", ".join(f"{name} = {_gain(law[name])}" for name in ("k", "k1", "k2") if name in law)
    return [
        ("program", f"{program['description']}, {program['duration']:.4f} s"),
        ("law", f"'{law['kind']}', {gains}"),
        ("error at the start", f"{_degrees(content['findings']['initial_angle'])}°, on the {start['sheet']} sheet"),
        ("simulated", f"{content['duration']:.4f} s"),
    ]


def _motion(content: dict[str, Any]) -> list[tuple[str, str]]:
    found, unit = content["findings"], content["law"]["command"].replace("rad", "°")
    settled, closed, norm, peak = found["settled"], found["closed_form"], found["norm"], found["peak_command"]
    when = "not reached and kept" if settled["time"] is None else f"from {settled['time']:.4f} s on"
    return [
        ("error at the end", "-" if found["final_angle"] is None else f"{_degrees(found['final_angle'])}°"),
        (f"within {_degrees(settled['angle'])}°", when),
        ("closed form", _closed(closed)),
        ("largest command", "-" if peak is None else f"{_degrees(peak['value'])} {unit} at {peak['time']:.6g} s"),
        ("limit of command", _limit(content["command_limit"], unit)),
        ("|λ|", f"{number(norm['least'])} to {number(norm['largest'])}{_drift(norm['drift'])}"),
    ]


def _print_columns(console: Console, content: dict[str, Any]) -> None:
    columns = content["columns"]
    count = len(columns["time"])
    shown = np.unique(np.linspace(0, count - 1, min(ROWS, count)).round().astype(int))
    headers = {name: names for name, names in HEADERS.items() if name in columns}
    values = {name: np.array(columns[name], dtype=float)[shown] for name in headers}
    for name in {"angle", "closed_form_angle", "rate", "command"} & headers.keys():
        values[name] = np.degrees(values[name])
    values["rate"] = values["rate"][:, 1:]
    values["command"] = np.linalg.norm(values["command"][:, 1:], axis=1)
    unit = content["law"]["command"].replace("rad", "°")
    heading(console, f"t [s], error angle [°], body rate ω [°/s], length of the command [{unit}], |λ|")
    console.print(numbers_table(values, headers, {}, significant=("angle", "closed_form_angle", "command")))
    if len(shown) < count:
        console.print(Text(f"{len(shown)} of {count} instants; the files hold, and --json prints, them all"))


def _closed(closed: dict[str, Any]) -> str:
    if closed["applies"]:
        return f"met within {number(closed['deviation'], 3)}, the largest deviation of the error quaternion"
    return f"does not apply: {closed['reason']}"


def _limit(limit: float | list[float] | None, unit: str) -> str:
    if limit is None:
        return "none"
    return ", ".join(_degrees(x) for x in (limit if isinstance(limit, list) else [limit])) + f" {unit}"


def _drift(drift: float | None) -> str:
    return "" if drift is None else f", {number(drift, 3)} from what it should be"


def _gain(value: Any) -> str:
    if isinstance(value, list):
        return "matrix" if isinstance(value[0], list) else "(" + ", ".join(f"{x:.4g}" for x in value) + ")"
    return f"{value:.6g}"


def _degrees(value: float) -> str:
    return number(math.degrees(value))
