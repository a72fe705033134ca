"""`qtraj report`: a result as a page for the browser."""

import json
from pathlib import Path

import typer

from qtraj.cli.frame_option import FrameName, frame_of, frame_option
from qtraj.cli.terminal import guarded, stdout


def report(
    result: Path = typer.Argument(
        Path("qtraj-out"), metavar="RESULT", help="A folder of results, a dataset, or a saved path."
    ),
    out: Path | None = typer.Option(None, metavar="DIR", help="Folder for the page; without it, that of RESULT."),
    frame: FrameName | None = frame_option("that of the dataset; upright for a saved path"),
    as_json: bool = typer.Option(False, "--json", help="Print what was found as JSON instead."),
) -> None:
    """Write a result as one HTML file to look at in a browser, without any network.

    It shows the path with its moving frame, or an attitude with its moving
    axes, beside everything over time, with slider, play and pause, tables and
    provenance. RESULT is what the other commands write: a folder, a dataset
    (.nc, .zarr, .parquet, .csv), or a saved path (.toml, .json). The page of a
    folder, and of its paths.nc or table.nc, is report.html; that of another file
    has its name: path.toml becomes path.html.
    """
    with guarded():  # imports here, so that --help need not wait for xarray
        from qtraj.cli.reporting.text import print_report
        from qtraj.cli.reporting.work import run

        content = run(result, out, None if frame is None else frame_of(frame))
    if as_json:
        typer.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        print_report(stdout(), content)
