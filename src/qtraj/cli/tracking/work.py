"""The work of `qtraj track`: from a scenario to a motion and its files."""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from qtraj.cli.columns import write_csv
from qtraj.cli.content import provenance, scenario_content
from qtraj.cli.output import Writer, check_folder, write_all
from qtraj.cli.terminal import watching
from qtraj.cli.tracking.content import track_columns, track_content
from qtraj.cli.tracking.findings import closed_form
from qtraj.cli.tracking.job import Job, prepare
from qtraj.cli.turning.course import program_attitudes
from qtraj.io.dataset import write_netcdf
from qtraj.io.instants import Column, instants_dataset
from qtraj.io.scenario import TRACK, read_scenario
from qtraj.io.tracking_model import TrackingScenario
from qtraj.motion.attitude import Attitude
from qtraj.motion.simulation.simulate import simulate
from qtraj.motion.simulation.solution import Solution
from qtraj.viz.figures import save
from qtraj.viz.track_figure import track_figure

SYMBOLS = {"rad": "rad", "1": "", "rad s-1": "rad/s", "rad s-2": "rad/s²"}
LETTERS = {"component": "wxyz", "body": "xyz"}


def run(file: Path | None, out: Path) -> tuple[dict[str, Any], bool]:
    """Simulate a closed loop and write it: what there is to say, and whether the integration finished.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        check_folder(out)
        given = read_scenario(TRACK if file is None else file, TrackingScenario)
        watch.say("preparing the program and the law")
        job = prepare(given)
        watch.say("simulating")
        solution, references = solve(job)
        watch.say("comparing with the closed form")
        closed = closed_form(job, references, solution)
        columns = track_columns(job, references, solution, closed)
        content = track_content(given, job, solution, closed, columns)
        watch.say("writing")
        writers = _writers(job, solution, columns, content, provenance(given.file, scenario_content(given)))
        content["files"] = [str(file) for file in write_all(out, writers)]
    return content, content["finished"]


def solve(job: Job) -> tuple[Solution, Attitude]:
    """The motion, and the program at its instants.

    **Raises:** ValueError for a program without an attitude at one of them.
    """
    references = program_attitudes(job.program, jnp.asarray(job.times))
    good = np.isfinite(np.asarray(references.quaternion)).all(axis=1)
    if not good.all():
        raise ValueError(f"the program has no attitude at t = {job.times[int(np.argmin(good))]:.6g} s")
    solution = simulate(
        job.program,
        job.law,
        job.quaternion,
        job.rate,
        job.times,
        job.disturbance,
        job.sensor,
        job.actuator,
        rtol=job.rtol,
        atol=job.atol,
        jumps=job.jumps,
    )
    return solution, references


def csv_headers(columns: dict[str, Column]) -> dict[str, list[str]]:
    """The names of the columns of the CSV file, with their units."""
    headers = {"time": ["time [s]"]}
    for name, column in columns.items():
        unit = f" [{SYMBOLS[column.unit]}]" if SYMBOLS[column.unit] else ""
        letters = [f"_{letter}" for letter in LETTERS[column.axis]] if column.axis else [""]
        headers[name] = [f"{name}{letter}{unit}" for letter in letters]
    return headers


def _writers(
    job: Job, solution: Solution, columns: dict[str, Column], content: dict[str, Any], notes: dict[str, str]
) -> dict[str, Writer]:
    """The files to write, by name."""
    dataset = instants_dataset(job.times, columns, notes | {"law": content["law"]["kind"], "result": content["result"]})
    values = {"time": job.times} | {name: column.values for name, column in columns.items()}
    figure = track_figure(dataset, content["findings"]["settled"]["angle"], content["command_limit"])
    return {
        "solution.toml": solution.save,
        "table.nc": lambda file: write_netcdf(dataset, file),
        "table.csv": lambda file: write_csv(values, csv_headers(columns), file),
        "track.png": lambda file: save(figure, file),
        "track.svg": lambda file: save(figure, file),
    }
