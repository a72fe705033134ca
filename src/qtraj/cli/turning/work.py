"""The work of `qtraj turn`: from a scenario to a program and its files."""

from pathlib import Path
from typing import Any

import numpy as np

from qtraj.cli.content import provenance, scenario_content
from qtraj.cli.output import Writer, check_folder, write_all
from qtraj.cli.results import result_writers
from qtraj.cli.terminal import watching
from qtraj.cli.turning.content import turn_content
from qtraj.cli.turning.course import even_times, fine_times, turn_columns
from qtraj.cli.turning.job import legs, turn_limits, turn_program
from qtraj.io.instants import instants_dataset
from qtraj.io.scenario import TURN, read_scenario
from qtraj.io.turn_model import TurnScenario
from qtraj.viz.slew_figure import slew_figure

BOUNDED = {"max_rate": "angle_rate", "max_acceleration": "angle_acceleration"}
"""The column that each limit bounds."""


def run(file: Path | None, out: Path, samples: int) -> tuple[dict[str, Any], bool]:
    """Make the program of a turn and write it: what there is to say, and whether all limits are met.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        check_folder(out)
        given = read_scenario(TURN if file is None else file, TurnScenario)
        watch.say("turning")
        try:
            program = turn_program(given.scenario, given.scenario.angles)
        except ValueError as error:
            raise ValueError(f"{given.file}: {error}") from error
        turns = legs(program)
        times, fine = even_times(turns, samples), fine_times(turns)
        body = given.scenario.body
        inertia = None if body is None else body.inertia
        both = turn_columns(program, turns, np.concatenate([times, fine]), inertia)  # at once: one compilation
        columns = {name: c._replace(values=c.values[: len(times)]) for name, c in both.items()}
        drawn = {name: c._replace(values=c.values[len(times) :]) for name, c in both.items()}
        content = turn_content(given, program, turns, times, columns)
        watch.say("writing")
        notes = provenance(given.file, scenario_content(given)) | {"law": content["law"], "result": content["result"]}
        limits = turn_limits(given.scenario.law, given.scenario.angles)
        bounds: dict[str, Any] = {BOUNDED[name]: limit for name, limit in limits.items() if name in BOUNDED}
        if body is not None and body.max_torque is not None:
            bounds["torque"] = body.max_torque
        dataset = instants_dataset(times, columns, notes, bounds)
        figure = slew_figure(instants_dataset(fine, drawn, notes), limits)
        writers: dict[str, Writer] = {"program.toml": program.save, **result_writers(dataset, figure, "turn")}
        content["files"] = [str(file) for file in write_all(out, writers)]
    return content, content["met"]
