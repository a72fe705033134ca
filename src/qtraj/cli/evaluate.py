"""Implement `qtraj evaluate`, which tabulates the path of a scenario, or a saved path."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.path.spiral_helix import SpiralHelix
    from qtraj.path.vehicle import Vehicle
    from qtraj.scenario.reader import ScenarioFile

OUTPUTS = ("position", "velocity", "acceleration", "speed", "curvature", "torsion", "quaternion", "rate", "defined")
SAMPLES = 25
MAX_INSTANTS = 1_000_000
"""Maximum number of instants; a larger number is probably a mistake."""

MOTION = {"position": ["x", "y", "z"], "speed": ["speed"], "curvature": ["κ"], "torsion": ["χ"]}
QUATERNION = ["λ0", "λ1", "λ2", "λ3"]


@terminal.command(out=typer.Option(None, metavar="DIR", help="Folder for table.nc and table.csv."))
def evaluate(
    watch: Watch,
    scenario: Path = typer.Argument(..., metavar="SCENARIO", help="A scenario, or a saved path (TOML or JSON)."),
    samples: int | None = typer.Option(
        None, min=2, metavar="N", help=f"Number of instants, including both ends. \\[default: {SAMPLES}]"
    ),
    step: float | None = typer.Option(
        None, metavar="SECONDS", help="Time between instants, instead of --samples. The end is always included."
    ),
    also: list[str] = typer.Option(
        [], metavar="NAME", help="Additional output of qtraj.evaluate, such as yaw_rate. May be repeated."
    ),
    frame: FrameName | None = terminal.frame_option(),
) -> Outcome:
    """Tabulate time, position, speed, curvature, torsion, attitude and rate of a path.

    The path of a scenario is not tuned. Attitude and rate are those of the upright frame, unless --frame selects
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
    from qtraj.viz import result_files

    loaded, path, fitted, vehicle = _path(scenario)
    also = _additional_outputs(also, vehicle)
    times = instants(float(path.duration), samples, step)
    watch.say("evaluating")
    table = evaluated(
        path, times, (*OUTPUTS, *also), (frame or FrameName.upright).frame(), continuous=True, vehicle=vehicle
    )
    bends = np.asarray(evaluated(path, times, ("defined",)).defined)
    content = {
        "fit": facts_of(fitted),
        "frame": table.frame,
        "path": {"duration": float(path.duration), "length": float(path.length()), "turn": float(path.turn)},
        **tabular(table.record()),
        "bends": bends.tolist(),
    }
    dataset = table_dataset(table, fitted, loaded.provenance())
    writers = result_files.table(dataset, headers=path_headers(dataset, also))
    failed = fitted is not None and not bool(fitted.successful)
    return Outcome(content, partial(_show, fitted=fitted), loaded, failed, writers)


def _additional_outputs(also: list[str], vehicle: "Vehicle | None") -> list[str]:
    """Return the outputs of the option --also, and the quantities of the vehicle.

    **Raises:** ValueError if the vehicle lacks the data for an output.
    """
    from qtraj.path.channel import CHANNELS, provided
    from qtraj.path.quantity import QUANTITIES
    from qtraj.scenario.path import require_vehicle

    for name in also:
        require_vehicle(vehicle, CHANNELS[name].needs if name in CHANNELS else "", f"--also {name}")
    available = provided(vehicle)
    return [*also, *(x.variable for x in QUANTITIES.values() if x.needs_vehicle and x.needs in available)]


def _path(file: Path) -> tuple["ScenarioFile[Any]", "SpiralHelix", "Fitted | None", "Vehicle | None"]:
    """Return the scenario of a file, its path, the fit of the path and the vehicle, or None for missing values.

    For a saved path, there is no scenario, fit or vehicle.
    """
    from qtraj.io.input_file import read_input
    from qtraj.io.saved import saved_path
    from qtraj.scenario.reader import ScenarioFile, scenario_in

    given = read_input(file)
    if given.is_saved:
        return ScenarioFile(file, None, given.hash), saved_path(file), None, None
    loaded = scenario_in(given, "path")
    task = KINDS["path"].build(loaded)
    return loaded, task.path, task.fitted, task.limits.vehicle


def instants(duration: float, samples: int | None, step: float | None) -> np.ndarray:
    """Return the instants [s] to evaluate, from 0 to the duration.

    **Raises:** ValueError for both `samples` and `step`, or for an invalid number of instants.
    """
    if samples is not None and samples > MAX_INSTANTS:
        raise ValueError(f"--samples must be at most {MAX_INSTANTS}, but {samples} was given")
    if step is None:
        return np.linspace(0.0, duration, SAMPLES if samples is None else samples)
    if samples is not None:
        raise ValueError("--samples and --step were both given: pass one of them")
    if not (step > 0 and duration / step < MAX_INSTANTS):
        raise ValueError(
            f"--step must be positive and result in at most {MAX_INSTANTS} instants, but {step:g} s was given for a "
            f"path of {duration:.6g} s"
        )
    times = step * np.arange(int(duration / step * (1 + 1e-12)) + 1)
    return times if times[-1] >= duration * (1 - 1e-9) else np.append(times, duration)


def _show(console: Console, content: dict[str, Any], fitted: "Fitted | None") -> None:
    """Print the path, and two or more tables, because one table would be wider than 80 columns."""
    from qtraj.path.existence import MISSING

    path, frame = content["path"], content["frame"]
    turn = f"{math.degrees(path['turn']):.2f}° about the axis"
    console.print(Text(f"Path: {path['duration']:.4f} s, {path['length']:.4f} m, {turn}"))
    layout.print_fit(console, fitted)
    columns = {name: np.array(values, dtype=float) for name, values in content["columns"].items()}
    defined = columns["defined"].astype(bool)
    exists = {"torsion": np.array(content["bends"], dtype=bool), "quaternion": defined, "rate": defined}
    for title, headers in _tables(frame).items():
        if set(headers) <= set(columns):
            layout.heading(console, title)
            console.print(layout.numbers_table(columns, headers, exists))
    if len(defined) > layout.MAX_ROWS:
        hidden = len(defined) - layout.MAX_ROWS
        console.print(Text(f"… : {hidden} instants are not printed; use --out DIR or --json for all instants"))
    if missing := int(np.sum(~defined)):
        console.print(Text(f"- : the {frame} frame does not exist ({MISSING[frame]}) at {missing} instants"))


def _tables(frame: str) -> dict[str, dict[str, list[str]]]:
    """Return the headers of the columns of each table by its title; a table is printed if all its columns exist."""
    from qtraj.path.frame_axes import axes_of
    from qtraj.path.moment_quantities import MOMENT_QUANTITIES
    from qtraj.path.road_quantities import ROAD_QUANTITIES

    rates = [f"ω_{symbol}" for symbol in axes_of(frame).symbols]
    forces = {x.name: [x.name if x.unit == "1" else x.symbol] for x in ROAD_QUANTITIES}
    moments = {x.name: [x.symbol] for x in MOMENT_QUANTITIES}
    tables = {
        "t [s], position [m], speed [m/s], curvature κ and torsion χ [1/m]": MOTION,
        f"t [s], quaternion λ and rate ω [rad/s] of the {frame} frame": {"quaternion": QUATERNION, "rate": rates},
        "t [s], forces F of the road [N], friction utilisation, power P of the drive [W]": forces,
        "t [s], moments M that rotate the vehicle with the natural trihedral [N·m]": moments,
    }
    return {title: {"time": ["t"]} | headers for title, headers in tables.items()}
