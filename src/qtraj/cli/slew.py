"""Implement `qtraj slew`, which computes slews between attitudes within limits."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.progress_bar import watching
from qtraj.foundation.units import symbol
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.motion.programs.slew_verdict import SlewVerdict
    from qtraj.scenario.slew import SlewScenario

BOUNDED = {"max_rate": "angle_rate", "max_acceleration": "angle_acceleration"}
"""The column to which each limit applies."""
HEADERS = {
    "time": ["t"],
    "angle": ["Φ"],
    "angle_rate": ["rate"],
    "angle_acceleration": ["accel."],
    "quaternion": ["λ0", "λ1", "λ2", "λ3"],
}


def slew(
    scenario: Path | None = terminal.scenario_argument("slew"),
    out: Path = terminal.out_option(),
    samples: int = typer.Option(201, min=2, max=100_000, metavar="N", help="Number of instants, including both ends."),
    as_json: bool = terminal.json_option(),
) -> None:
    """Compute a slew from one attitude to another, or through several attitudes, about fixed axes.

    The duration is the minimum within the limits of rate, acceleration, jerk and torque, unless the scenario specifies
    a duration. Torques need the inertia of the body in the table `body`. The command writes the program (program.toml),
    its table (table.nc, table.csv) and a figure (slew.png, slew.svg). The exit code is 1 if a limit is violated.
    """
    with terminal.guarded():
        outcome = run(scenario, out, samples)
    terminal.finish(outcome, as_json)


def run(file: Path | None, out: Path, samples: int) -> Outcome:
    """Compute the program of a slew and write the results.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        # Imported here, so that --help does not wait for pydantic, xarray and matplotlib.
        from qtraj.cli.output import check_folder, header, provenance, result_writers, tabular, write_all
        from qtraj.foundation.plain import plain
        from qtraj.foundation.record import to_dataset
        from qtraj.motion.programs.slew_history import fine_times, slew_history
        from qtraj.motion.programs.slew_verdict import judge_slew
        from qtraj.scenario.reader import read_scenario
        from qtraj.viz.slew_figure import slew_figure

        check_folder(out)
        loaded = read_scenario(file, "slew")
        watch.say("slewing")
        scenario, program = loaded.scenario, KINDS["slew"].build(loaded)
        body = scenario.body
        inertia, max_torque = (None, None) if body is None else (body.inertia, body.max_torque)
        limits, end = scenario.law.limits(scenario.angles), scenario.end.unit_quaternion(scenario.angles)
        verdict = judge_slew(program, limits, inertia, max_torque, end)
        times = np.linspace(0.0, verdict.duration, samples if verdict.duration > 0 else 1)
        both = slew_history(program, np.concatenate([times, fine_times(program)]), inertia)  # one call, to compile once
        table, drawn = both[: len(times)].record(), both[len(times) :]
        content = header("slew", loaded) | {
            "law": scenario.law.kind,
            "verdict": plain(verdict.record()),
            "notes": _notes(scenario, verdict),
            **tabular(table),
            "files": [],
        }
        watch.say("writing")
        about = provenance(loaded) | {"law": scenario.law.kind, "result": verdict.result}
        dataset = to_dataset(table, about)
        bounds: dict[str, Any] = {BOUNDED[name]: limit for name, limit in limits.items() if name in BOUNDED}
        for name, limit in (bounds | ({} if max_torque is None else {"torque": max_torque})).items():
            dataset[name].attrs["limit"] = limit
        figure = slew_figure(to_dataset(drawn.record(), about), limits)
        writers = {"program.toml": program.save, **result_writers(dataset, figure, "slew")}
        content["files"] = [str(file) for file in write_all(out, writers)]
    return Outcome(content, lambda console: _show(console, content, verdict), not verdict.met, loaded.warnings)


def _notes(scenario: "SlewScenario", verdict: "SlewVerdict") -> list[str]:
    """Return notes on effects that a user may not expect."""
    notes = []
    for k, (name, attitude) in enumerate(scenario.attitudes().items()):
        if (length := attitude.beyond_half_turn(scenario.angles)) is not None:
            slewed = "." if k == 0 else f", {layout.degrees(float(verdict.angles[k - 1]))}°."
            notes.append(
                f"The rotation vector of [{name}] has an angle of {layout.degrees(length)}°, more than a half turn. "
                f"The slew is the shorter rotation to the same attitude{slewed}"
            )
    scale = math.degrees(1.0) if scenario.angles == "rad" else 1.0
    rates = {"starts": scenario.law.start_rate, "ends": scenario.law.end_rate}
    moving = [f"{verb} at {layout.number(scale * rate)}°/s" for verb, rate in rates.items() if rate]
    if moving:
        notes.append(
            f"The slew {' and '.join(moving)}, but the program is at rest before and after the slew, so the commanded "
            "rate is discontinuous."
        )
    return notes


def _show(console: Console, content: dict[str, Any], verdict: "SlewVerdict") -> None:
    """Print scenario, results and files, with angles in degrees, for a terminal with 80 columns."""
    layout.print_scenario(console, content["scenario"])
    for k in range(len(verdict.angles)):
        _show_slew(console, content["verdict"], k)
    if verdict.sign < 0:
        text = f"The program ends at λ = {_vector(verdict.end)}, the specified quaternion with the opposite sign, "
        hint = "which is the same attitude. Start the next program from the quaternion with this sign."
        console.print(Text(text + hint))
    if np.isfinite(verdict.least_duration):
        console.print(Text(f"The fastest slew within the limits takes {float(verdict.least_duration):.4f} s."))
    for note in content["notes"]:
        console.print(Text(note))
    _show_limits(console, content["verdict"])
    values = {name: np.array(content["columns"][name], dtype=float) for name in HEADERS}
    for name in ("angle", "angle_rate", "angle_acceleration"):
        values[name] = np.degrees(values[name])
    layout.heading(console, "Program: t [s], angle Φ [°], rate [°/s], accel. [°/s²], quaternion λ")
    layout.print_instants(console, values, HEADERS)
    layout.heading(console, f"Result: law '{content['law']}'")
    console.print(Text(verdict.result))
    layout.print_files(console, content["files"])


def _show_slew(console: Console, verdict: dict[str, Any], k: int) -> None:
    count, start, duration = len(verdict["angle"]), verdict["start"][k], verdict["duration"][k]
    layout.heading(console, f"Slew {k + 1} of {count}" if count > 1 else "Slew")
    rows = [
        ("angle", f"{math.degrees(verdict['angle'][k]):.4f}°"),
        ("axis, body", _vector(verdict["axis_body"][k])),
        ("axis, inertial", _vector(verdict["axis_inertial"][k])),
        ("duration", f"{duration:.4f} s"),
    ]
    if start:
        rows.append(("from", f"{start:.4f} s on"))
    if switches := [t for t in verdict["switch_time"] if start < t < start + duration]:
        rows.append(("switches at", ", ".join(f"{t:.4f}" for t in switches) + " s"))
    console.print(layout.facts_table(rows))


def _show_limits(console: Console, verdict: dict[str, Any]) -> None:
    layout.heading(console, "Peaks and limits")
    table = layout.plain_table("", right=("peak", "limit", "margin", "at [s]"), last=("unit", ""))
    names = ("limit", "limit_unit", "peak", "bound", "margin", "peak_time", "status", "active")
    for name, unit, peak, bound, margin, time, status, active in zip(*(verdict[key] for key in names), strict=True):
        shown = layout.degrees if unit.startswith("rad") else layout.number
        numbers = [shown(value) for value in (peak, bound, 0.0 if active else margin)]
        ending = Text(status) if bound is None else layout.verdict("active" if active else status)
        label = Text(symbol(unit).replace("rad", "°"))
        table.add_row(name.removeprefix("max_"), *numbers, layout.number(time, 6), label, ending)
    console.print(table)


def _vector(values: Any) -> str:
    vector = np.array(values, dtype=float)
    return "-" if np.isnan(vector).any() else "(" + ", ".join(f"{round(v, 6) + 0.0:.6f}" for v in vector) + ")"
