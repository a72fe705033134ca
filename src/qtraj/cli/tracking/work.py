"""The work of `qtraj track`: from a scenario to a motion and its files."""

from pathlib import Path
from typing import Any

from qtraj.cli.content import provenance, scenario_content
from qtraj.cli.output import Writer, check_folder, write_all
from qtraj.cli.results import result_writers
from qtraj.cli.terminal import Watch, watching
from qtraj.cli.tracking.content import track_columns, track_content
from qtraj.cli.tracking.course import Course, solve
from qtraj.cli.tracking.job import Job, prepare
from qtraj.io.instants import instants_dataset
from qtraj.io.scenario import TRACK, ScenarioFile, read_scenario
from qtraj.io.tracking_model import TrackingScenario
from qtraj.viz.simulation_figure import simulation_figure


def run(file: Path | None, out: Path, samples: int | None, frame: str | None = None) -> tuple[dict[str, Any], bool]:
    """Simulate a closed loop and write it: what there is to say, and whether the integration finished.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        check_folder(out)
        given = read_scenario(TRACK if file is None else file, TrackingScenario)
        job, course = _simulated(given, samples, frame, watch)
        columns = track_columns(job, course)
        content = track_content(given, job, course, columns)
        watch.say("writing")
        notes = provenance(given.file, scenario_content(given)) | {
            "law": content["law"]["kind"],
            "result": content["result"],
        }
        closed = content["findings"]["closed_form"]
        notes["closed_form"] = "applies" if closed["applies"] else f"does not apply: {closed['reason']}"
        limit, saturation = content["command_limit"], content["saturation"]
        notes |= {} if saturation is None else {"saturation": saturation}
        dataset = instants_dataset(job.times, columns, notes, {} if limit is None else {"command": limit})
        figure = simulation_figure(dataset, content["findings"]["settled"]["angle"], limit)
        writers: dict[str, Writer] = {
            "solution.toml": course.tabulated().save,
            **result_writers(dataset, figure, "track"),
        }
        content["files"] = [str(file) for file in write_all(out, writers)]
    return content, content["finished"]


def _simulated(
    given: ScenarioFile[TrackingScenario], samples: int | None, frame: str | None, watch: Watch
) -> tuple[Job, Course]:
    """The closed loop of a scenario and its motion; a ValueError names the file."""
    try:
        watch.say("preparing the program and the law")
        job = prepare(given, samples, frame)
        watch.say("simulating")
        return job, solve(job)
    except ValueError as error:
        raise ValueError(f"{given.file}: {error}") from error
