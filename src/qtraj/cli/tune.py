"""`qtraj tune`: boundary velocities that meet the limits of a scenario."""

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from qtraj.cli.frame_option import FrameName, frame_of, frame_option
from qtraj.cli.terminal import guarded, stdout
from qtraj.design.tuning.choices import MOTIONS, OBJECTIVES, either

NOT_MET = 1


if TYPE_CHECKING:  # a checker of types takes no names that are read from a registry
    Motion = StrEnum
    Objective = StrEnum
else:  # for completion by the Tab key, too
    Motion = StrEnum("Motion", {name: name for name in MOTIONS})
    Objective = StrEnum("Objective", {name: name for name in OBJECTIVES})


def tune(
    scenario: Path | None = typer.Argument(None, metavar="SCENARIO.toml", help="Without it: the embedded scenario."),
    out: Path = typer.Option(Path("qtraj-out"), help="Folder for the results.", metavar="DIR"),
    as_json: bool = typer.Option(False, "--json", help="Print the outcome as JSON instead."),
    motion: Motion | None = typer.Option(
        None, metavar="MOTION", help=f"In place of the scenario's: {either(MOTIONS, '')}."
    ),
    objective: Objective | None = typer.Option(
        None, metavar="OBJECTIVE", help=f"In place of the scenario's: {either(OBJECTIVES, '')}."
    ),
    starts: int | None = typer.Option(
        None, min=1, metavar="N", help="In place of the scenario's: searches, from the given states and about them."
    ),
    frame: FrameName | None = frame_option(),
) -> None:
    """Tune the boundary velocities of a path until its limits hold, and write both paths.

    Writes a labelled dataset (paths.nc), the tuned path (path.toml), the whole outcome (tuning.toml) and a figure
    (tuning.png, tuning.svg). Exit code 1 where the limits are not met, or a path does not follow its
    recording.
    """
    with guarded():  # imports here, so that --help need not wait for pydantic, xarray and matplotlib
        from qtraj.cli.tuning.job import Choice
        from qtraj.cli.tuning.report import print_tuning
        from qtraj.cli.tuning.work import run

        choice = Choice(motion and motion.value, objective and objective.value, starts)
        content, met = run(scenario, out, choice, frame_of(frame))
    if as_json:
        typer.echo(json.dumps(content, indent=2, allow_nan=False))
    else:
        print_tuning(stdout(), content)
    raise typer.Exit(0 if met else NOT_MET)
