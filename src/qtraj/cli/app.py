"""The commands, gathered."""

import typer

from qtraj._version import __version__
from qtraj.cli.evaluate import evaluate
from qtraj.cli.report import report
from qtraj.cli.track import track
from qtraj.cli.tune import tune
from qtraj.cli.turn import turn

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command(epilog="Example:  qtraj tune turn.toml --out results")(tune)
app.command(epilog="Example:  qtraj evaluate turn.toml --samples 11")(evaluate)
app.command(epilog="Example:  qtraj turn quarter.toml --out results")(turn)
app.command(epilog="Example:  qtraj track loop.toml --out results")(track)
app.command(epilog="Example:  qtraj tune && qtraj report    (reads qtraj-out, writes qtraj-out/report.html)")(report)


def _version(wanted: bool) -> bool:
    if wanted:
        typer.echo(f"qtraj {__version__}")
        raise typer.Exit
    return wanted


@app.callback(epilog="Example:  qtraj tune    (runs the embedded scenario and writes ./qtraj-out)")
def root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """Where a vehicle must be, and how it must turn: paths from boundary states or recordings.

    Exit codes: 0 done, 1 limits not met or no convergence (results are written all the same), 2 bad input.
    """
