"""`qtraj turn`: a turn from one attitude to another within limits."""

import json
from pathlib import Path

import typer

from qtraj.cli.terminal import guarded, stdout

BROKEN = 1


def turn(
    scenario: Path | None = typer.Argument(None, metavar="SCENARIO.toml", help="Without it: the embedded scenario."),
    out: Path = typer.Option(Path("qtraj-out"), help="Folder for the results.", metavar="DIR"),
    samples: int = typer.Option(201, min=2, max=100_000, metavar="N", help="Number of instants, both ends included."),
    as_json: bool = typer.Option(False, "--json", help="Print the outcome as JSON instead."),
) -> None:
    """Turn from one attitude to another, or through several, about fixed axes.

    The angle proceeds as fast as limits of rate, acceleration, jerk and torque allow, or in a given time; torques need
    the inertia of the body, in a table [body]. Writes the program (program.toml), its table (table.nc, table.csv) and a
    figure (turn.png, turn.svg). Exit code 1 where a limit is broken.
    """
    with guarded():  # imports here, so that --help need not wait for pydantic, xarray and matplotlib
        from qtraj.cli.turning.report import print_turn
        from qtraj.cli.turning.work import run

        content, met = run(scenario, out, samples)
    if as_json:
        typer.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        print_turn(stdout(), content)
    raise typer.Exit(0 if met else BROKEN)
