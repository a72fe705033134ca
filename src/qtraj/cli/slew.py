"""Implement `qtraj slew`, which computes slews between attitudes within limits."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.number_text import degrees
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
    from qtraj.motion.programs.slew_verdict import SlewVerdict
    from qtraj.scenario.slew import SlewScenario


@terminal.command(
    "qtraj slew  (the built-in scenario)",
    "qtraj slew camera.toml --out results --samples 401",
)
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
    table, drawn = both[: len(times)], both[len(times) :]
    content = {
        "law": part.law.kind,
        "verdict": plain(verdict.record()),
        "notes": _notes(part, program, verdict),
        **tabular(table.record()),
    }
    from qtraj.viz.command_files import slew_files  # imported after the computation, because matplotlib is slow

    about = loaded.provenance() | {"law": part.law.kind, "result": verdict.result}
    writers = slew_files(program, table, drawn, limits, max_torque, about)
    return Outcome(content, _text(content, verdict), loaded, not verdict.met, writers)


def _notes(scenario: "SlewScenario", program: "EulerTurn | SlewSequence", verdict: "SlewVerdict") -> list[str]:
    """Return notes on effects that a user may not expect."""
    from qtraj.motion.programs.slew_facts import end_rates_text

    notes = []
    for k, (name, attitude) in enumerate(scenario.attitudes().items()):
        if (length := attitude.beyond_half_turn(scenario.angles)) is not None:
            slewed = "." if k == 0 else f", {degrees(float(verdict.angles[k - 1]))}°."
            form = "rotation vector" if attitude.euler is None else "Euler angles"
            has = "has an angle" if attitude.euler is None else "contain an angle"
            notes.append(
                f"The {form} of [{name}] {has} of {degrees(length)}°, more than a half turn. "
                f"The slew is the shorter rotation to the same attitude{slewed}"
            )
    return [*notes, text] if (text := end_rates_text(program.law)) else notes


def _text(content: dict[str, Any], verdict: "SlewVerdict") -> list[layout.Part]:
    """Return the slews, their limits and the motion as text, with angles in degrees."""
    from qtraj.motion.programs import slew_facts

    count, columns = len(verdict.angles), ("peak", "limit", "margin", "at [s]")
    titles = [f"Slew {k + 1} of {count}" for k in range(count)] if count > 1 else ["Slew"]
    return [
        *(layout.facts(title, slew_facts.slew_fact_rows(verdict, k)) for k, title in enumerate(titles)),
        *slew_facts.end_texts(verdict),
        *content["notes"],
        layout.grouped_table(
            "Peaks and limits", [slew_facts.slew_limit_rows(verdict)], "", right=columns, last=("unit", "")
        ),
        *layout.instants(slew_facts.MOTION_TITLE, content["columns"], content["units"], slew_facts.MOTION_HEADERS),
        layout.heading(f"Result: law '{content['law']}'"),
        verdict.result,
    ]
