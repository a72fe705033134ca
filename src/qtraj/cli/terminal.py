"""Define what commands have in common: options, output streams, and exit codes."""

import functools
import inspect
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import typer
from rich.console import Console

from qtraj._version import __version__
from qtraj.cli import BAD_INPUT, INTERRUPTED, layout
from qtraj.cli.console import message, stderr, stdout
from qtraj.cli.track_options import as_options, collected, track_parameters
from qtraj.foundation.folder import Writer, check_folder, write_all
from qtraj.foundation.plain import finite
from qtraj.foundation.progress_bar import watching
from qtraj.path.frame_axes import FRAMES
from qtraj.scenario import KINDS

if TYPE_CHECKING:  # type checkers cannot read names from a registry
    from qtraj.scenario.reader import ScenarioFile

    FrameName = StrEnum
else:  # an enumeration, for shell completion
    FrameName = StrEnum("FrameName", {name: name for name in FRAMES})

TRACK = "track"
"""The parameter of a command that receives the options of recordings."""

FOLDER = "folder"
"""The parameter of a command that receives the option --out, because the command writes a store itself."""

FAILED = 1
"""Exit code of a run with a violated limit or an unsuccessful computation."""

UNTIL = "the old name works until 1.0"
"""The last clause of a warning about an old name."""


ABOUT_FRAMES = (
    "upright (x forward, y left, z up; for wheeled vehicles), natural (tangent, principal normal, binormal; flips "
    "at inflections of the path), rotation-minimizing (zero rate about the tangent), or thrust-aligned (z along "
    "the thrust, acceleration minus gravity; for multirotors)."
)


def frame_option(otherwise: str = "upright") -> Any:
    """Return the option `--frame`; `otherwise` describes its default."""
    return typer.Option(
        None, "--frame", metavar="FRAME", help=f"Frame of the attitudes: {ABOUT_FRAMES} \\[default: {otherwise}]"
    )


def scenario_argument(kind: str) -> Any:
    """Return the argument SCENARIO for scenarios of one kind."""
    about = f"A scenario of {KINDS[kind].about} (default: the built-in scenario)."
    return typer.Argument(None, metavar="SCENARIO.toml", help=about)


class Outcome(NamedTuple):
    """The result of a command.

    `content`: the result as JSON types; numbers that are not finite become null. `text`: the parts of the result as
    text. `loaded`: the scenario, or None. `failed`: whether the exit code is 1. `writers`: the files to write, by name.
    `optional`: names of files that the command writes only for some inputs; if an earlier run wrote them and this run
    does not, they are removed. `folder`: the folder for the files if the option --out is omitted; None for no files.
    `hint`: the last line of the text.
    """

    content: dict[str, Any]
    text: Iterable[layout.Part]
    loaded: "ScenarioFile[Any] | None" = None
    failed: bool = False
    writers: Mapping[str, Writer] = MappingProxyType({})
    optional: Collection[str] = ()
    folder: Path | None = None
    hint: str = ""


OUT = typer.Option(Path("qtraj-out"), metavar="DIR", help="Folder for the results.")
"""The option `--out` of commands that always write files."""

JSON = typer.Option(False, "--json", help="Print the results as JSON instead of text.")
"""The option `--json`."""

QUIET = typer.Option(False, "--quiet", help="Do not show progress.")
"""The option `--quiet`."""


def command(*examples: str, out: Any = OUT) -> Callable[[Callable[..., Outcome]], Callable[..., None]]:
    """Return a decorator that converts a function to a command with these examples and the options of all commands.

    The command writes the files of the function's outcome, prints the outcome and exits. The parameters of the function
    are a `Watch`, the argument of the command, and its other options. A parameter `track` receives the options of
    recordings as keys of [track], and a parameter `folder` the option --out. If the function raises an OSError or a
    ValueError for bad input, the command prints one message and exits with code 2.
    """

    def decorate(run: Callable[..., Outcome]) -> Callable[..., None]:
        @functools.wraps(run)
        def command(*, out: Path | None, as_json: bool, quiet: bool, **options: Any) -> None:
            with guarded(), watching(quiet) as watch:
                if out is not None:
                    check_folder(out)
                known = inspect.signature(run).parameters
                own = {TRACK: collected(options)} if TRACK in known else {}
                own |= {FOLDER: out} if FOLDER in known else {}
                outcome = run(watch, **options, **own)
                watch.say("writing")
                content, text = _write(run.__name__, outcome, out or outcome.folder, as_json)
            for warning in outcome.loaded.warnings if outcome.loaded else ():
                message("warning", f"{warning}; {UNTIL}")
            if as_json:
                typer.echo(text)
            else:
                _show(stdout(), outcome, content)
            raise typer.Exit(FAILED if outcome.failed else 0)

        signature = inspect.signature(run)
        _, argument, *options = (p for p in signature.parameters.values() if p.name not in (TRACK, FOLDER))
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        common = [
            inspect.Parameter("out", kind, default=out, annotation=Path | None),
            inspect.Parameter("as_json", kind, default=JSON, annotation=bool),
            inspect.Parameter("quiet", kind, default=QUIET, annotation=bool),
        ]
        recorded = track_parameters() if TRACK in signature.parameters else []
        parameters = [argument, *common, *options, *recorded]
        vars(command).update(__signature__=signature.replace(parameters=parameters), examples=examples)
        return command

    return decorate


def _write(command: str, outcome: Outcome, folder: Path | None, as_json: bool) -> tuple[dict[str, Any], str]:
    """Write the files of an outcome to a folder; return the content of the output, and its text as JSON.

    The text is created before any file is written. It is empty if `as_json` is false.
    """
    from qtraj.viz.result_files import obsolete_files  # imported here, because xarray delays --help

    writers = {} if folder is None else outcome.writers
    obsolete = [] if folder is None else obsolete_files(folder, writers, outcome.optional)
    scenario = {} if outcome.loaded is None else {"scenario": outcome.loaded.about()}
    files = {"files": [str(Path(folder or "", name)) for name in writers], "removed": [str(file) for file in obsolete]}
    content = {"qtraj": __version__, "command": command} | scenario | outcome.content | files
    text = json.dumps(finite(content), indent=2, allow_nan=False) if as_json else ""
    if folder is not None and (writers or obsolete):
        write_all(folder, writers, obsolete)
    return content, text


def _show(console: Console, outcome: Outcome, content: dict[str, Any]) -> None:
    """Print the scenario, the content and the files of an outcome, for a terminal with 80 columns."""
    if outcome.loaded is not None:
        layout.print_scenario(console, content["scenario"])
    layout.show(console, outcome.text)
    layout.print_files(console, "Files written", content["files"])
    layout.print_files(console, "Files removed, because an earlier run wrote them", content["removed"])
    layout.show(console, [outcome.hint])


@contextmanager
def guarded() -> Iterator[None]:
    """Convert invalid input to one message and exit code 2, and an interrupt to exit code 130."""
    try:
        yield
    except BrokenPipeError:  # the reader of the output has closed the pipe
        raise
    except OSError as error:
        _fail(f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error))
    except (ValueError, ModuleNotFoundError) as error:  # messages about missing packages say how to install them
        _fail(str(error))
    except OverflowError as error:
        _fail(f"a number is too large for the computation ({error})")
    except KeyboardInterrupt:
        stderr().print("interrupted", markup=False)
        raise typer.Exit(INTERRUPTED) from None


def _fail(text: str) -> None:
    message("error", as_options(text))
    raise typer.Exit(BAD_INPUT) from None
