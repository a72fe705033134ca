"""Define the application with all commands, and the old names of renamed commands."""

import functools
from collections.abc import Callable

import typer

from qtraj._version import __version__
from qtraj.cli.evaluate import evaluate
from qtraj.cli.report import report
from qtraj.cli.retime import retime
from qtraj.cli.route import route
from qtraj.cli.simulate import simulate
from qtraj.cli.slew import slew
from qtraj.cli.terminal import UNTIL, warn
from qtraj.cli.tune import tune

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _prose(docstring: str | None) -> str:
    """Return a docstring with each paragraph on one line, which the terminal wraps."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in (docstring or "").split("\n\n"))


def _examples(*lines: str) -> str:
    """Return the examples of a command, one per line, as text for the end of the help."""
    return "\n\n".join(("Examples:", *lines))


def _add(command: Callable[..., None], *examples: str, old: str | None = None) -> None:
    """Add a command with its examples, and an alias with the `old` name, which emits a warning."""
    help, epilog = _prose(command.__doc__), _examples(*examples)
    app.command(help=help, epilog=epilog)(command)
    if old is None:
        return

    @functools.wraps(command)
    def renamed(*args: object, **options: object) -> None:
        warn(f"`qtraj {old}` is now `qtraj {command.__name__}`; {UNTIL}")
        command(*args, **options)

    app.command(old, help=help, epilog=epilog, hidden=True)(renamed)


_add(
    tune,
    "qtraj tune  (the built-in scenario)",
    "qtraj tune turn.toml --out results",
    "qtraj tune turn.toml --objective fastest --motion hermite",
)
_add(
    evaluate,
    "qtraj evaluate turn.toml --samples 11",
    "qtraj evaluate results/path.toml --step 0.1 --out table",
)
_add(
    route,
    "qtraj route  (the built-in scenario)",
    "qtraj route drive.csv --out drive",
    "qtraj route bus.toml --out results",
)
_add(
    retime,
    "qtraj retime  (the built-in scenario)",
    "qtraj retime bus.toml --out results",
    "qtraj retime drive.csv --limit speed=13.9 --limit lateral_acceleration=2",
)
_add(
    slew,
    "qtraj slew  (the built-in scenario)",
    "qtraj slew camera.toml --out results --samples 401",
    old="turn",
)
_add(
    simulate,
    "qtraj simulate  (the built-in scenario)",
    "qtraj simulate loop.toml --out results --json",
    old="track",
)
_add(
    report,
    "qtraj report  (reads qtraj-out, writes qtraj-out/report.html)",
    "qtraj report results",
    "qtraj report helix.parquet --out pages",
)


def _version(requested: bool) -> bool:
    if requested:
        typer.echo(f"qtraj {__version__}")
        raise typer.Exit
    return requested


@app.callback(
    epilog=_examples(
        "qtraj tune  (runs the built-in scenario, writes qtraj-out)",
        "qtraj report  (writes an HTML report of the results in qtraj-out)",
        "qtraj --install-completion  (installs tab completion)",
    )
)
def root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    """Compute paths, slews and closed-loop motion of vehicles from boundary states, recordings and limits.

    The exit code is 0 for success, 1 for violated limits or no convergence, and 2 for invalid input.

    Results are also written if the exit code is 1.
    """
