"""The outcome of `qtraj turn` on the terminal, in degrees, readable at 80 columns."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from qtraj.cli.layout import (
    degrees,
    facts_table,
    heading,
    number,
    plain_table,
    print_files,
    print_instants,
    print_scenario,
    verdict,
)

HEADERS = {
    "time": ["t"],
    "angle": ["Φ"],
    "angle_rate": ["rate"],
    "angle_acceleration": ["accel."],
    "quaternion": ["λ0", "λ1", "λ2", "λ3"],
}


def print_turn(console: Console, content: dict[str, Any]) -> None:
    """The whole outcome, from the scenario to the files written."""
    print_scenario(console, content["scenario"])
    turns = content["turns"]
    for k, turn in enumerate(turns):
        _print_turn(console, turn, f"Turn {k + 1} of {len(turns)}" if len(turns) > 1 else "Turn")
    _print_end(console, content)
    _print_limits(console, content["limits"])
    _print_program(console, content["columns"])
    heading(console, f"Result: law '{content['law']}'")
    console.print(Text(content["result"]))
    print_files(console, content["files"])


def _print_turn(console: Console, turn: dict[str, Any], title: str) -> None:
    heading(console, title)
    rows = [
        ("angle", f"{np.degrees(turn['angle']):.4f}°"),
        ("axis, body", _vector(turn["axis_body"])),
        ("axis, inertial", _vector(turn["axis_inertial"])),
        ("duration", f"{turn['duration']:.4f} s"),
    ]
    if turn["start"]:
        rows.append(("from", f"{turn['start']:.4f} s on"))
    if turn["switches"]:
        rows.append(("switches at", ", ".join(f"{t:.4f}" for t in turn["switches"]) + " s"))
    console.print(facts_table(rows))


def _print_end(console: Console, content: dict[str, Any]) -> None:
    end = content["end"]
    if end["sign"] < 0:
        text = f"The program ends at λ = {_vector(end['quaternion'])}, the given quaternion with the other sign: "
        console.print(Text(text + "the same attitude by the shorter way. Go on from this sign."))
    if content["least_duration"] is not None:
        console.print(Text(f"Within the limits the shortest turn found takes {content['least_duration']:.4f} s."))
    for note in content["notes"]:
        console.print(Text(note))


def _print_limits(console: Console, limits: dict[str, dict[str, Any]]) -> None:
    heading(console, "Peaks and limits")
    table = plain_table("", right=("peak", "limit", "margin", "at [s]"), last=("unit", ""))
    for name, entry in limits.items():
        status = "binds" if entry["binding"] else entry["status"] or "no limit"
        margin = 0.0 if entry["binding"] else entry["margin"]
        shown = degrees if entry["unit"].startswith("rad") else number
        numbers = [shown(value) for value in (entry["value"], entry["limit"], margin)]
        ending = verdict(status) if entry["status"] else Text(status)
        unit = Text(entry["unit"].replace("rad", "°"))
        table.add_row(name.removeprefix("max_"), *numbers, number(entry["time"], 6), unit, ending)
    console.print(table)


def _print_program(console: Console, columns: dict[str, Any]) -> None:
    values = {name: np.array(columns[name], dtype=float) for name in HEADERS}
    for name in ("angle", "angle_rate", "angle_acceleration"):
        values[name] = np.degrees(values[name])
    heading(console, "Program: t [s], angle Φ [°], rate [°/s], accel. [°/s²], quaternion λ")
    print_instants(console, values, HEADERS)


def _vector(values: list[float] | None) -> str:
    return "-" if values is None else "(" + ", ".join(f"{round(v, 6) + 0.0:.6f}" for v in values) + ")"
