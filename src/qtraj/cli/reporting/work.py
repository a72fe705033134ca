"""The work of `qtraj report`: from a result to its page."""

from pathlib import Path
from typing import Any

from qtraj.cli.output import check_folder, write_all
from qtraj.cli.reporting.content import report_content
from qtraj.cli.reporting.job import find, is_folder
from qtraj.cli.terminal import watching

PAGE = "report.html"


def run(result: Path, out: Path | None) -> dict[str, Any]:
    """Write the page of a result: what there is to say.

    **Raises:** OSError or ValueError for bad input, or a missing package, before anything is written.
    """
    folder = out or (result if is_folder(result) else result.parent)
    with watching() as watch:
        watch.say("reading")
        check_folder(folder)
        try:
            job = find(result)
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
        writers = {PAGE: lambda file: file.write_text(page, encoding="utf-8", newline="\n")}
        content["files"] = [str(file) for file in write_all(folder, writers)]
    return content
