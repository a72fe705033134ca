"""Implement `qtraj evaluate`, which tabulates the path of a scenario, or a saved path."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch
from qtraj.path.frame_axes import UPRIGHT
from qtraj.path.sample_times import SAMPLES, sample_times
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.io.track.reading import Recording
    from qtraj.path.spiral_helix import SpiralHelix
    from qtraj.path.vehicle import Vehicle
    from qtraj.scenario.reader import ScenarioFile

OUTPUTS = ("position", "velocity", "acceleration", "speed", "curvature", "torsion", "quaternion", "rate", "defined")


@terminal.command(
    "qtraj evaluate turn.toml --samples 11",
    "qtraj evaluate results/path.toml --step 0.1 --out table",
    out=typer.Option(None, metavar="DIR", help="Folder for table.nc and table.csv."),
)
def evaluate(
    watch: Watch,
    scenario: Path = typer.Argument(..., metavar="SCENARIO", help="A scenario, or a saved path (TOML or JSON)."),
    samples: int | None = typer.Option(
        None, min=2, metavar="N", help=f"Number of instants, including both ends. \\[default: {SAMPLES}]"
    ),
    step: float | None = typer.Option(
        None, metavar="SECONDS", help="Time between instants, instead of --samples. The end of the path is included."
    ),
    also: list[str] = typer.Option(
        [], metavar="NAME", help="Additional output of qtraj.evaluate, such as yaw_rate. May be repeated."
    ),
    frame: FrameName | None = terminal.frame_option(),
    track: dict[str, Any] | None = None,
) -> Outcome:
    """Tabulate time, position, speed, curvature, torsion, attitude and rate of a path.

    The path of a scenario is not tuned. Attitude and rate refer to the upright frame, unless --frame selects
    another frame. The quaternion is scalar first, body to world. If the scenario has a table `vehicle`, the output
    includes forces, friction and power. Outputs requested by --also are added to the files and to the JSON output. The
    exit code is 1 if the path does not fit its recording.
    """
    watch.say("reading the path")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.batch.evaluate import evaluate as evaluated
    from qtraj.design.fitting.route_facts import facts_of
    from qtraj.foundation.plain import tabular
    from qtraj.io.dataset import table_dataset
    from qtraj.io.instants_csv import path_headers
    from qtraj.io.track.reading import recorded
    from qtraj.motion.programs.rotation_minimizing import frame_named
    from qtraj.path.channel import CHANNELS, vehicle_outputs
    from qtraj.scenario.vehicle import require_vehicle
    from qtraj.viz import result_files

    loaded, path, recording, fitted, vehicle = _path(scenario, track or {})
    for name in also:
        require_vehicle(vehicle, CHANNELS[name].needs if name in CHANNELS else "", f"--also {name}")
    also = [*also, *vehicle_outputs(vehicle)]
    times = _times(float(path.duration), samples, step)
    watch.say("evaluating")
    table = evaluated(path, times, (*OUTPUTS, *also), frame_named(frame or UPRIGHT), continuous=True, vehicle=vehicle)
    content = {
        "recording": recorded(recording),
        "fit": facts_of(fitted),
        "frame": table.frame,
        "path": {"duration": float(path.duration), "length": float(path.length()), "turn": float(path.turn)},
        **tabular(table.record()),
        "bends": np.asarray(evaluated(path, times, ("defined",)).defined).tolist(),
    }
    dataset = table_dataset(table, fitted, loaded.provenance())
    writers = result_files.table(dataset, headers=path_headers(dataset, also))
    return Outcome(
        content, _text(content, recording, fitted), loaded, not (fitted is None or bool(fitted.successful)), writers
    )


def _times(duration: float, samples: int | None, step: float | None) -> np.ndarray:
    """Return the `sample_times`, or raise a ValueError that names the option."""
    if samples is not None and step is not None:
        raise ValueError("--samples and --step were both given: pass one of them")
    with naming("--"):
        return sample_times(duration, samples, step)


def _path(
    file: Path, track: dict[str, Any]
) -> tuple["ScenarioFile[Any]", "SpiralHelix", "Recording | None", "Fitted | None", "Vehicle | None"]:
    """Return the scenario in a file, the path, the recording, its fit, and the vehicle; missing values are None.

    `track` replaces keys of the table [track]. For a saved path, there is no scenario, recording, fit or vehicle.
    """
    from qtraj.io.input_file import read_input, with_track
    from qtraj.io.saved import saved_path
    from qtraj.scenario.reader import ScenarioFile, scenario_in

    given = with_track(read_input(file), track)
    if given.is_saved:
        return ScenarioFile(file, None, given.hash), saved_path(file), None, None, None
    loaded = scenario_in(given, "path")
    task = KINDS["path"].build(loaded)
    return loaded, task.path, task.recording, task.fitted, task.limits.vehicle


def _text(content: dict[str, Any], recording: "Recording | None", fitted: "Fitted | None") -> Iterator[layout.Part]:
    """Yield the path, and two or more tables, because one table would be wider than 80 columns."""
    from qtraj.io.printed_headers import path_tables
    from qtraj.path.existence import MISSING

    path, frame = content["path"], content["frame"]
    turn = f"{math.degrees(path['turn']):.2f}° about the axis"
    yield f"Path: {path['duration']:.4f} s, {path['length']:.4f} m, {turn}"
    yield from layout.recording(recording)
    yield from layout.fit(fitted)
    columns = {name: np.array(values, dtype=float) for name, values in content["columns"].items()}
    defined = columns["defined"].astype(bool)
    exists = {"torsion": np.array(content["bends"], dtype=bool), "quaternion": defined, "rate": defined}
    for title, headers in path_tables(frame, columns).items():
        yield layout.heading(title)
        yield layout.numbers_table(columns, headers, exists)
    if (hidden := len(defined) - layout.MAX_ROWS) > 0:
        yield f"… : {hidden} instants are not printed; use --out DIR or --json for all instants"
    if missing := int(np.sum(~defined)):
        yield f"- : the {frame} frame does not exist ({MISSING[frame]}) at {missing} instants"
