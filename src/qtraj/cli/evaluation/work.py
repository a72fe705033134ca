"""The work of `qtraj evaluate`: from a file to a table and its files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.batch.evaluate import evaluate
from qtraj.cli.columns import csv_headers, write_csv
from qtraj.cli.content import provenance, scenario_content
from qtraj.cli.evaluation.tabulate import HEADERS, OUTPUTS, table_content
from qtraj.cli.output import check_folder, write_all
from qtraj.cli.terminal import watching
from qtraj.cli.tuning.job import is_saved, lay, saved_path
from qtraj.design.fitting.facts import facts
from qtraj.design.fitting.fitted import Fitted
from qtraj.io.dataset import conventions, with_fit, write_netcdf
from qtraj.io.scenario import content_hash, read_scenario
from qtraj.io.scenario_model import Scenario
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.spiral_helix import SpiralHelix

SAMPLES = 25
MOST = 1_000_000
"""More instants than this are surely a mistake."""


def run(
    file: Path, samples: int | None, step: float | None, out: Path | None, also: Sequence[str], frame: Frame
) -> dict[str, Any]:
    """Evaluate the path of a file, and write it where a folder is given: what there is to say.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading the path")
        if out is not None:
            check_folder(out)
        path, about, fitted = _path(file)
        times = instants(float(path.duration), samples, step)
        watch.say("evaluating")
        table = evaluate(path, times, (*OUTPUTS, *also), frame, continuous=True)
        bends = np.asarray(evaluate(path, times, ("defined",)).defined)
        content = table_content(path, table, bends, about, None if fitted is None else facts(fitted))
        if out is not None:
            dataset = table.to_xarray()
            known = csv_headers(dataset)
            headers = HEADERS | {name: known[name] for name in ("rate", *also) if name not in HEADERS}
            columns = {name: np.asarray(getattr(table, name)) for name in headers}
            found: dict[str, Any] = {}
            texts = {} if fitted is None else with_fit(found, fitted)
            dataset = dataset.assign(found)
            dataset.attrs |= conventions(table.frame) | provenance(file, about) | texts
            writers = {
                "table.nc": lambda file: write_netcdf(dataset, file),
                "table.csv": lambda file: write_csv(columns, headers, file),
            }
            content["files"] = [str(written) for written in write_all(out, writers)]
    return content


def instants(duration: float, samples: int | None, step: float | None) -> np.ndarray:
    """The instants to evaluate, from 0 to the duration [s].

    **Raises:** ValueError where both numbers are given, or the step makes no sensible number of instants.
    """

    if samples is not None and samples > MOST:
        raise ValueError(f"--samples {samples} was given, but expected at most {MOST}")
    if step is None:
        return np.linspace(0.0, duration, SAMPLES if samples is None else samples)
    if samples is not None:
        raise ValueError("--samples and --step were both given: give one of them")
    if not (step > 0 and duration / step < MOST):
        raise ValueError(
            f"--step {step:g} was given, but expected a positive number of seconds that makes at most {MOST} instants "
            f"of this path, which lasts {duration:.6g} s"
        )
    times = step * np.arange(int(duration / step * (1 + 1e-12)) + 1)
    return times if times[-1] >= duration * (1 - 1e-9) else np.append(times, duration)


def _path(file: Path) -> tuple[SpiralHelix, dict[str, Any], Fitted | None]:
    """The path of a file, with what is known about the scenario, and the fit it comes from."""

    if is_saved(file):
        known = {"file": str(file), "sha256": content_hash(file.read_bytes())}
        return saved_path(file), known | dict.fromkeys(("name", "description", "source")), None
    given = read_scenario(file, Scenario)
    job = lay(given)
    return job.path, scenario_content(given), job.fitted
