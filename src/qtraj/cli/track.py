"""`qtraj track`: a body under feedback follows a program."""

import json
from pathlib import Path

import typer

from qtraj.cli.frame_option import FrameName, frame_option
from qtraj.cli.terminal import guarded, stdout

NOT_FINISHED = 1


def track(
    scenario: Path | None = typer.Argument(None, metavar="SCENARIO.toml", help="Without it: the embedded scenario."),
    out: Path = typer.Option(Path("qtraj-out"), help="Folder for the results.", metavar="DIR"),
    samples: int | None = typer.Option(
        None, min=2, max=100_000, metavar="N", help="Number of instants, both ends included; before the scenario's."
    ),
    frame: FrameName | None = frame_option("the scenario's; upright"),
    as_json: bool = typer.Option(False, "--json", help="Print the outcome as JSON instead."),
) -> None:
    """Simulate a body that a feedback law makes follow a program of attitude.

    The program is a turn, the frame of a path, or a saved one; disturbance, sensor and actuator may be added. The
    error is compared with its closed form. Writes the motion (solution.toml), its table (table.nc, table.csv) and a
    figure (track.png, track.svg). Exit code 1 where the integration did not finish.
    """
    with guarded():  # imports here, so that --help need not wait for pydantic, xarray and matplotlib
        from qtraj.cli.tracking.report import print_track
        from qtraj.cli.tracking.work import run

        content, finished = run(scenario, out, samples, frame and frame.value)
    if as_json:
        typer.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        print_track(stdout(), content)
    raise typer.Exit(0 if finished else NOT_FINISHED)
