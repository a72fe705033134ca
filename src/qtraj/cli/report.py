"""Implement `qtraj report`, which writes an HTML report of a result."""

from pathlib import Path
from typing import Any

import typer

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.foundation.progress_bar import Watch


@terminal.command(
    "qtraj report  (reads qtraj-out, writes qtraj-out/report.html)",
    "qtraj report results",
    "qtraj report helix.parquet --out pages",
    out=typer.Option(None, metavar="DIR", help="Folder for the page (default: the folder of RESULT)."),
)
def report(
    watch: Watch,
    result: Path = typer.Argument(
        Path("qtraj-out"), metavar="RESULT", help="A folder of results, a dataset, or a saved path."
    ),
    frame: FrameName | None = terminal.frame_option("the frame of the dataset; upright for a saved path"),
) -> Outcome:
    """Write a report of a result as one HTML file, which does not need a network connection.

    The report animates the path with its moving frame, or the attitude with its
    axes, and has controls for the animation. It also contains plots over time,
    tables and provenance. RESULT is an output of another command: a folder, a
    dataset (.nc, .zarr, .parquet, .csv), or a saved path (.toml, .json). The report
    of a folder, or of its paths.nc or table.nc, is named report.html. Other reports
    are named after their files: the report of path.toml is path.html.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for xarray.
    from qtraj.motion.programs.rotation_minimizing import frame_named
    from qtraj.viz.report.page import html, report_of
    from qtraj.viz.report.source import DATASETS, find, is_folder
    from qtraj.viz.result_files import REPORT

    try:
        source = find(result, None if frame is None else frame_named(frame))
        watch.say("drawing")
        summary = report_of(source.dataset, source.tuned)
        page = html(summary)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if str(result) in text else f"{result}: {text}") from error
    content: dict[str, Any] = {"result": str(source.file)} | summary.summary()
    whole = is_folder(result) or result.name in DATASETS
    name = REPORT if whole else f"{result.stem}.html"  # several files in one folder need separate reports
    writers = {name: lambda file: file.write_text(page, encoding="utf-8", newline="\n")}
    folder = result if is_folder(result) else result.parent
    hint = "Open this file in a browser; it does not need a network connection."
    text = [
        layout.styled(content["title"], layout.TITLE),
        *content["findings"],
        *content["notes"],
        *(layout.styled(f"Warning: {warning}", layout.ALERT) for warning in content["warnings"]),
        *(f"{body['name']}: {body['instants']} instants, {body['duration']:.4f} s" for body in content["bodies"]),
    ]
    return Outcome(content, text, writers=writers, folder=folder, hint=hint)
