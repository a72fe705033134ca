"""`qtraj evaluate`: the path of a scenario, or a saved one, as a table."""

import json
from pathlib import Path

import typer

from qtraj.cli.frame_option import FrameName, frame_of, frame_option
from qtraj.cli.terminal import guarded, stdout

NOT_FITTED = 1


def evaluate(
    scenario: Path = typer.Argument(..., metavar="SCENARIO", help="A scenario, or a saved path (TOML or JSON)."),
    samples: int | None = typer.Option(
        None, min=2, metavar="N", help="Number of instants, both ends included. [default: 25]"
    ),
    step: float | None = typer.Option(
        None, metavar="SECONDS", help="Time between instants instead; the end is always included."
    ),
    also: list[str] = typer.Option(
        [], metavar="NAME", help="A further output of qtraj.evaluate, such as yaw_rate; several with one option each."
    ),
    frame: FrameName | None = frame_option(),
    out: Path | None = typer.Option(None, metavar="DIR", help="Folder for table.nc and table.csv."),
    as_json: bool = typer.Option(False, "--json", help="Print the table as JSON instead."),
) -> None:
    """Tabulate a path: time, position, speed, curvature, torsion, attitude and rate.

    Of a scenario it is the path before tuning. Attitude and rate are those of the upright frame, unless --frame names
    another; the quaternion is scalar first, body to world. What --also names is added to the files and to JSON. Exit
    code 1 where the path does not follow its recording.
    """
    with guarded():  # imports here, so that --help need not wait for pydantic and xarray
        from qtraj.cli.evaluation.tabulate import print_table
        from qtraj.cli.evaluation.work import run

        content = run(scenario, samples, step, out, also, frame_of(frame))
    if as_json:
        typer.echo(json.dumps(content, allow_nan=False))
    else:
        print_table(stdout(), content)
    if content["fit"] is not None and not content["fit"]["successful"]:
        raise typer.Exit(NOT_FITTED)
