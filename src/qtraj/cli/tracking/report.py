"""The outcome of `qtraj track` on the terminal, in degrees, readable at 80 columns."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from qtraj.cli.layout import degrees, facts_table, heading, number, print_files, print_instants, print_scenario

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
    if not content["law"]["stable"]:
        console.print(Text(_unstable(content["law"]), style="bold red"))
    heading(console, "Motion")
    console.print(facts_table(_motion(content)))
    if content["findings"]["closed_form"]["met"] is False:
        console.print(Text(_departure(content["findings"]["closed_form"]), style="bold red"))
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
        ("error at the start", f"{degrees(content['findings']['initial_angle'])}°, on the {start['sheet']} sheet"),
        ("simulated", f"{content['duration']:.4f} s"),
    ]


def _motion(content: dict[str, Any]) -> list[tuple[str, str]]:
    found, unit = content["findings"], content["law"]["command"].replace("rad", "°")
    settled, norm, peak, least = found["settled"], found["norm"], found["peak_command"], found["least_error_norm"]
    when = "not reached and kept" if settled["time"] is None else f"from {settled['time']:.4f} s on"
    return [
        ("error at the end", f"{degrees(found['final_angle'])}°" if found["final_angle"] is not None else "-"),
        (f"within {degrees(settled['angle'])}°", when),
        ("closed form", _closed(found["closed_form"])),
        ("largest command", _peak(peak, unit, content["saturation"] == "axis")),
        ("limit of command", _limit(content["command_limit"], unit, content["saturation"])),
        ("|λ|", f"{number(norm['least'])} to {number(norm['largest'])}{_drift(norm['drift'])}"),
        ("least |μ|", _least(least)),
        ("found at", f"{found['instants']} instants, whatever the table asks for"),
    ]


def _print_columns(console: Console, content: dict[str, Any]) -> None:
    columns = content["columns"]
    applies = content["findings"]["closed_form"]["applies"]
    left_out = () if applies else ("closed_form_angle",)
    headers = {name: names for name, names in HEADERS.items() if name in columns and name not in left_out}
    values = {name: np.array(columns[name], dtype=float) for name in headers}
    for name in {"angle", "closed_form_angle", "rate", "command"} & headers.keys():
        values[name] = np.degrees(values[name])
    values["command"] = np.linalg.norm(values["command"], axis=1)
    unit = content["law"]["command"].replace("rad", "°")
    heading(console, f"t [s], error angle [°], body rate ω [°/s], length of the command [{unit}], |λ|")
    print_instants(console, values, headers, significant=("angle", "closed_form_angle", "command"))


def _closed(closed: dict[str, Any]) -> str:
    if not closed["applies"]:
        return f"does not apply: {closed['reason']}"
    relative = f"{number(closed['deviation'], 3)} of the largest error quaternion"
    return f"met within {relative}" if closed["met"] else f"departs from it by {relative}"


def _departure(closed: dict[str, Any]) -> str:
    return (
        f"The motion is not that of the closed form: the tolerances explain no more than {number(closed['bound'], 3)}. "
        "Take smaller simulation.rtol and simulation.atol."
    )


def _unstable(law: dict[str, Any]) -> str:
    return (
        f"This law is unstable: with these gains errors grow, the fastest as exp({number(law['growth'], 4)} t)."
        if law["growth"] > 0
        else "This law brings no error to rest: with these gains errors neither grow nor decay."
    )


def _least(least: dict[str, Any] | None) -> str:
    if least is None:
        return "-"
    return number(least["value"]) + (", at any time, by the closed form" if least["exact"] else "")


def _peak(peak: dict[str, Any] | None, unit: str, each_axis: bool) -> str:
    """The greatest command as its limit counts it: the length, or each component."""
    if peak is None:
        return "-"
    length = f"{degrees(peak['value'])} {unit} at {peak['time']:.6g} s"
    if not each_axis:
        return length
    return f"{', '.join(map(degrees, peak['axes']))} {unit} along x, y, z; length {length}"


def _limit(limit: float | list[float] | None, unit: str, saturation: str | None) -> str:
    if limit is None:
        return "none"
    values = ", ".join(degrees(x) for x in (limit if isinstance(limit, list) else [limit])) + f" {unit}"
    if saturation == "norm":
        return f"{values}, of the length"
    return f"{values} along x, y, z" if isinstance(limit, list) else f"{values} along each axis"


def _drift(drift: float | None) -> str:
    return "" if drift is None else f", {number(drift, 3)} from what it should be"


def _gain(value: Any) -> str:
    if isinstance(value, list):
        return "matrix" if isinstance(value[0], list) else "(" + ", ".join(f"{x:.4g}" for x in value) + ")"
    return f"{value:.6g}"
