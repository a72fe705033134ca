"""Implement `qtraj slew`, which computes slews between attitudes within limits."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.number_text import degrees
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.foundation.folder import Writer
    from qtraj.foundation.record import Record
    from qtraj.motion.programs.slew_verdict import SlewVerdict
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.slew import SlewScenario

BOUNDED = {"max_rate": "angle_rate", "max_acceleration": "angle_acceleration", "max_torque": "torque"}
"""The column to which each limit applies."""
HEADERS = {
    "time": ["t"],
    "angle": ["Φ"],
    "angle_rate": ["rate"],
    "angle_acceleration": ["accel."],
    "quaternion": ["λ0", "λ1", "λ2", "λ3"],
}
ANGLES = ("angle", "angle_rate", "angle_acceleration")
"""Columns that are printed in degrees."""


@terminal.command()
def slew(
    watch: Watch,
    scenario: Path | None = terminal.scenario_argument("slew"),
    samples: int = typer.Option(201, min=2, max=100_000, metavar="N", help="Number of instants, including both ends."),
) -> Outcome:
    """Compute a slew from one attitude to another, or through several attitudes, about fixed axes.

    The duration is the minimum within the limits of rate, acceleration, jerk and torque, unless the scenario specifies
    a duration. Torques need the inertia of the body in the table `body`. The command writes the program (program.toml),
    its table (table.nc, table.csv) and a figure (slew.png, slew.svg). The exit code is 1 if a limit is violated.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.foundation.plain import plain, tabular
    from qtraj.motion.programs.slew_history import fine_times, slew_history
    from qtraj.motion.programs.slew_verdict import judge_slew
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "slew")
    watch.say("slewing")
    part, program = loaded.scenario, KINDS["slew"].build(loaded)
    body = part.body
    inertia, max_torque = (None, None) if body is None else (body.inertia, body.max_torque)
    limits, end = part.law.limits(part.angles), part.end.unit_quaternion(part.angles)
    verdict = judge_slew(program, limits, inertia, max_torque, end)
    times = np.linspace(0.0, verdict.duration, samples if verdict.duration > 0 else 1)
    both = slew_history(program, np.concatenate([times, fine_times(program)]), inertia)  # one call, to compile once
    table, drawn = both[: len(times)].record(), both[len(times) :]
    content = {
        "law": part.law.kind,
        "verdict": plain(verdict.record()),
        "notes": _notes(part, verdict),
        **tabular(table),
    }
    writers = _files(loaded, program, verdict, table, drawn.record())
    return Outcome(content, partial(_show, verdict=verdict), loaded, not verdict.met, writers)


def _files(
    loaded: "ScenarioFile[SlewScenario]", program: Any, verdict: "SlewVerdict", table: "Record", drawn: "Record"
) -> "dict[str, Writer]":
    """Return the writers of the files: the program, its `table`, and a figure of the finer table `drawn`."""
    from qtraj.foundation.record import to_dataset
    from qtraj.viz import result_files
    from qtraj.viz.figures import slew_figure  # imported after the computation, because matplotlib is slow to import

    law, body, angles = loaded.scenario.law, loaded.scenario.body, loaded.scenario.angles
    about = loaded.provenance() | {"law": law.kind, "result": verdict.result}
    dataset, limits = to_dataset(table, about), law.limits(angles)
    bounds = {**limits, "max_torque": None if body is None else body.max_torque}
    for name, column in BOUNDED.items():
        if bounds.get(name) is not None:
            dataset[column].attrs["limit"] = bounds[name]
    return {
        **result_files.documents({"program.toml": program}),
        **result_files.table(dataset),
        **result_files.figure("slew", slew_figure(to_dataset(drawn, about), limits)),
    }


def _notes(scenario: "SlewScenario", verdict: "SlewVerdict") -> list[str]:
    """Return notes on effects that a user may not expect."""
    from qtraj.motion.programs.slew_facts import end_rates_text

    notes = []
    for k, (name, attitude) in enumerate(scenario.attitudes().items()):
        if (length := attitude.beyond_half_turn(scenario.angles)) is not None:
            slewed = "." if k == 0 else f", {degrees(float(verdict.angles[k - 1]))}°."
            notes.append(
                f"The rotation vector of [{name}] has an angle of {degrees(length)}°, more than a half turn. "
                f"The slew is the shorter rotation to the same attitude{slewed}"
            )
    law, unit = scenario.law, 1.0 if scenario.angles == "rad" else np.radians(1.0)
    if text := end_rates_text(unit * (law.start_rate or 0.0), unit * (law.end_rate or 0.0)):
        notes.append(text)
    return notes


def _show(console: Console, content: dict[str, Any], verdict: "SlewVerdict") -> None:
    """Print the slews, their limits and the motion, with angles in degrees."""
    from qtraj.motion.programs.slew_facts import slew_fact_rows, slew_limit_rows, vector_text

    count = len(verdict.angles)
    for k in range(count):
        layout.print_facts(console, f"Slew {k + 1} of {count}" if count > 1 else "Slew", slew_fact_rows(verdict, k))
    if verdict.sign < 0:
        text = f"The program ends at λ = {vector_text(verdict.end)}, the specified quaternion with the opposite sign, "
        hint = "which is the same attitude. Start the next program from the quaternion with this sign."
        console.print(Text(text + hint))
    if np.isfinite(verdict.least_duration):
        console.print(Text(f"The fastest slew within the limits takes {float(verdict.least_duration):.4f} s."))
    for note in content["notes"]:
        console.print(Text(note))
    layout.heading(console, "Peaks and limits")
    table = layout.plain_table("", right=("peak", "limit", "margin", "at [s]"), last=("unit", ""))
    for *cells, status in slew_limit_rows(verdict):
        table.add_row(*map(Text, cells), layout.verdict(status))
    console.print(table)
    title = "Program: t [s], angle Φ [°], rate [°/s], accel. [°/s²], quaternion λ"
    layout.print_instants(console, title, content["columns"], HEADERS, ANGLES)
    layout.heading(console, f"Result: law '{content['law']}'")
    console.print(Text(verdict.result))
