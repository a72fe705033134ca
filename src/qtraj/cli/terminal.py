"""Define what commands have in common: options, output streams, and exit codes."""

import functools
import inspect
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import typer
from rich.console import Console

from qtraj._version import __version__
from qtraj.cli import BAD_INPUT, INTERRUPTED
from qtraj.foundation.folder import Writer, check_folder, write_all
from qtraj.foundation.plain import finite
from qtraj.foundation.progress_bar import watching
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.motion.programs.rotation_minimizing import Frame
    from qtraj.scenario.reader import ScenarioFile

FAILED = 1
"""Exit code of a run that did not converge, or whose limits are not satisfied."""

UNTIL = "the old name works until 1.0"
"""The last clause of a warning about an old name."""


class FrameName(StrEnum):
    """The names of the frames along a path."""

    upright = "upright"
    natural = "natural"
    minimizing = "rotation-minimizing"
    thrust_aligned = "thrust-aligned"

    def frame(self) -> "Frame":
        """Return the frame with this name."""
        from qtraj.motion.programs.rotation_minimizing import frame_named  # imported here, because it delays --help

        return frame_named(self.value)


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


def out_option() -> Any:
    """Return the option `--out` of commands that always write files."""
    return typer.Option(Path("qtraj-out"), help="Folder for the results.", metavar="DIR")


def json_option() -> Any:
    """Return the option `--json`."""
    return typer.Option(False, "--json", help="Print the results as JSON instead of text.")


def scenario_argument(kind: str) -> Any:
    """Return the argument SCENARIO for scenarios of one kind."""
    about = f"A scenario of {KINDS[kind].about} (default: the built-in scenario)."
    return typer.Argument(None, metavar="SCENARIO.toml", help=about)


class Outcome(NamedTuple):
    """The result of a command.

    `content`: the result as JSON types; numbers that are not finite are printed as null. `show`: a function that prints
    the result. `failed`: whether the exit code is 1. `renamed`: warnings about renamed keys. `folder` and `writers`:
    the files to write, by name; None for no files.
    """

    content: dict[str, Any]
    show: Callable[[Console], None]
    failed: bool = False
    renamed: Sequence[str] = ()
    folder: Path | None = None
    writers: Mapping[str, Writer] = MappingProxyType({})


def header(command: str, loaded: "ScenarioFile[Any]") -> dict[str, Any]:
    """Return the first keys of a command's JSON output: the version, the command and the scenario."""
    return {"qtraj": __version__, "command": command, "scenario": loaded.about()}


def command(run: Callable[..., Outcome]) -> Callable[..., None]:
    """Convert a function to a command, which writes the files of its outcome, prints it and exits.

    The first argument of the function is a `Watch`. An OSError or ValueError for bad input, which the function raises
    before files are written, becomes one message and exit code 2. The option `as_json` selects the output format.
    """

    @functools.wraps(run)
    def command(*, out: Path | None, as_json: bool, **options: Any) -> None:
        with guarded(), watching() as watch:
            if out is not None:
                check_folder(out)
            outcome = run(watch, out=out, as_json=as_json, **options)
            folder, content = outcome.folder, outcome.content
            content["files"] = [] if folder is None else [str(folder / name) for name in outcome.writers]
            text = json.dumps(finite(content), indent=2, allow_nan=False) if as_json else ""
            watch.say("writing")
            if folder is not None:
                write_all(folder, outcome.writers)
        for warning in outcome.renamed:
            warn(f"{warning}; {UNTIL}")
        if as_json:
            typer.echo(text)
        else:
            outcome.show(stdout())
        raise typer.Exit(FAILED if outcome.failed else 0)

    signature = inspect.signature(run)
    _, *parameters = signature.parameters.values()
    command.__signature__ = signature.replace(parameters=parameters)  # pyright: ignore[reportAttributeAccessIssue]
    return command


def stdout() -> Console:
    """Return the console for results."""
    return Console(highlight=False)


def stderr() -> Console:
    """Return the console for progress, warnings and errors."""
    return Console(stderr=True, highlight=False)


def warn(text: str) -> None:
    """Print a warning."""
    stderr().print(f"warning: {text}", markup=False, soft_wrap=True)


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


def _fail(message: str) -> None:
    stderr().print(f"error: {message}", markup=False, soft_wrap=True)
    raise typer.Exit(BAD_INPUT) from None
