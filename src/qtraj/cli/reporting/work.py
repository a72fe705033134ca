"""The work of `qtraj report`: from a result to its page."""

from pathlib import Path
from typing import Any

from qtraj.cli.output import check_folder, write_all
from qtraj.cli.reporting.content import report_content
from qtraj.cli.reporting.job import DATASETS, find, is_folder
from qtraj.cli.terminal import watching
from qtraj.motion.programs.rotation_minimizing import Frame

PAGE = "report.html"
"""The page of a folder, and of the dataset in it that stands for the folder."""


def run(result: Path, out: Path | None, frame: Frame | None = None) -> dict[str, Any]:
    """Write the page of a result: what there is to say.

    `frame` is that of a saved path; the upright one without it.

    **Raises:** OSError or ValueError for bad input, or a missing package, before anything is written.
    """
    folder = out or (result if is_folder(result) else result.parent)
    with watching() as watch:
        watch.say("reading")
        check_folder(folder)
        try:
            job = find(result, frame)
            from qtraj.viz.report.page import html, report_of

            watch.say("drawing")
            report = report_of(job.dataset, job.tuned)
            page = html(report)
        except ModuleNotFoundError as error:
            raise ValueError(str(error)) from error
        except ValueError as error:
            text = str(error)
            raise ValueError(text if str(result) in text else f"{result}: {text}") from error
        content = report_content(job, report)
        watch.say("writing")
        writers = {page_name(result): lambda file: file.write_text(page, encoding="utf-8", newline="\n")}
        content["files"] = [str(file) for file in write_all(folder, writers)]
    return content


def page_name(result: Path) -> str:
    """The name of a result's page: that of a file is named after it, so that several in a folder keep theirs."""
    whole = is_folder(result) or result.name in DATASETS
    return PAGE if whole else f"{result.stem}.html"
