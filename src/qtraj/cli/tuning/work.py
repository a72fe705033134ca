"""The work of `qtraj tune`: from a scenario to an outcome and its files."""

from pathlib import Path
from typing import Any

import xarray

from qtraj.cli.content import provenance, scenario_content
from qtraj.cli.output import Writer, check_folder, write_all
from qtraj.cli.terminal import Watch, watching
from qtraj.cli.tuning.content import tune_content
from qtraj.cli.tuning.job import Choice, Job, is_saved, lay
from qtraj.cli.tuning.remarks import bounds_text, fixed_text
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.tune import tune
from qtraj.io.dataset import path_dataset, write_netcdf
from qtraj.io.scenario import DEFAULT, ScenarioFile, read_scenario
from qtraj.io.scenario_model import Scenario
from qtraj.motion.programs.rotation_minimizing import Frame


def run(file: Path | None, out: Path, choice: Choice, frame: Frame) -> tuple[dict[str, Any], bool]:
    """Tune a scenario and write its results: what there is to say, and whether all limits were met.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        check_folder(out)
        if file is not None and is_saved(file):
            raise ValueError(
                f"{file}: a saved path has no limits: write a scenario with path = '{file.name}' and [limits]"
            )
        given = read_scenario(DEFAULT if file is None else file, Scenario)
        job, before, best = solve(given, choice, watch)
        dataset = _dataset(given, job, before, best, frame)
        content = tune_content(given, job, before, best, dataset)
        dataset.attrs |= _remarks(content)
        watch.say("writing")
        content["files"] = [str(file) for file in write_all(out, _writers(dataset, best))]
    fitted = job.fitted is None or bool(job.fitted.successful)
    return content, fitted and best.converged and best.certificate.met


def solve(given: ScenarioFile[Scenario], choice: Choice, watch: Watch) -> tuple[Job, Certificate, Tuned]:
    """The job of a scenario, the findings on its path, and the outcome of its tuning.

    **Raises:** OSError or ValueError, naming the scenario, for bad input.
    """
    if not given.scenario.limits.given():
        raise ValueError(f"{given.file}: the table [limits] is missing or empty: there is nothing to tune for")
    watch.say("fitting the recording" if given.scenario.track else "laying the path")
    job = lay(given, choice)
    try:
        watch.say("judging the path")
        reference = None if job.corridor is None else job.path
        before = certify(job.path, job.limits, corridor=job.corridor, reference=reference)
        watch.say("tuning")
        best = tune(**job.tuning(), progress=watch.tuning)
    except ValueError as error:
        raise ValueError(f"{given.file}: {error}") from error
    return job, before, best


def _dataset(given: ScenarioFile[Scenario], job: Job, before: Certificate, best: Tuned, frame: Frame) -> xarray.Dataset:
    """Both paths, sampled, with the largest values that their certificates know."""
    attributes = provenance(given.file, scenario_content(given)) | {
        "tuning_objective": job.objective,
        "tuning_motion": job.motion,
        "tuning_status": best.status,
        "tuning_result": best.result,
    }
    paths = {"before": job.path, "after": best.path}
    findings = {"before": before, "after": best.certificate}
    return path_dataset(
        paths, job.limits, job.track, attributes=attributes, fitted=job.fitted, frame=frame, findings=findings
    )


def _remarks(content: dict[str, Any]) -> dict[str, str]:
    """What was held and bounded, and the warning, where there is any."""
    tuning = content["tuning"]
    texts = {"fixed": fixed_text(tuning), "bounds": bounds_text(tuning), "warning": content["warning"]}
    return {f"tuning_{name}": text for name, text in texts.items() if text}


def _writers(dataset: xarray.Dataset, best: Tuned) -> dict[str, Writer]:
    """The files to write, by name."""

    def draw(file: Path) -> None:
        from qtraj.viz.figures import save, tuning_figure  # here, so that matplotlib is loaded when all else is done

        save(tuning_figure(dataset), file)

    return {
        "paths.nc": lambda file: write_netcdf(dataset, file),
        "path.toml": best.path.save,
        "tuning.toml": best.save,
        "tuning.png": draw,
        "tuning.svg": draw,
    }
