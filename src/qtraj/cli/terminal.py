"""The terminal: what goes where, progress, and how a command ends."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress as Bars, SpinnerColumn, TextColumn, TimeElapsedColumn

from qtraj.cli import BAD_INPUT, INTERRUPTED
from qtraj.foundation.progress import Progress


def stdout() -> Console:
    """Where results go."""
    return Console(highlight=False)


def stderr() -> Console:
    """Where progress and errors go."""
    return Console(stderr=True, highlight=False)


@contextmanager
def guarded() -> Iterator[None]:
    """Turn bad input into one message and exit code 2, and an interrupt into exit code 130."""
    try:
        yield
    except BrokenPipeError:  # whoever read our output has gone
        raise
    except OSError as error:
        _fail(f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error))
    except ValueError as error:
        _fail(str(error))
    except OverflowError as error:
        _fail(f"a number is too large to compute with ({error})")
    except KeyboardInterrupt:
        stderr().print("interrupted", markup=False)
        raise typer.Exit(INTERRUPTED) from None


def _fail(message: str) -> None:
    stderr().print(f"error: {message}", markup=False, soft_wrap=True)
    raise typer.Exit(BAD_INPUT) from None


class Watch:
    """Progress on a terminal; silent elsewhere."""

    def __init__(self, shown: Bars | None):
        self._shown = shown
        self._task: Any = None if shown is None else shown.add_task("", total=None)

    def say(self, text: str) -> None:
        """What is being done now."""
        if self._shown is not None:
            self._shown.update(self._task, description=text, completed=0, total=None)

    def tuning(self, progress: Progress) -> None:
        """How far a tuning is."""
        if self._shown is not None:
            known = {"completed": progress.done, "total": progress.total}
            self._shown.update(self._task, description=f"tuning: {progress}", **known)


@contextmanager
def watching() -> Iterator[Watch]:
    """A `Watch` on stderr, wiped when done; nothing of it where stderr is no terminal."""
    console = stderr()
    if not console.is_terminal:
        yield Watch(None)
        return
    text = TextColumn("{task.description}", markup=False)
    with Bars(SpinnerColumn(), text, BarColumn(20), TimeElapsedColumn(), console=console, transient=True) as shown:
        yield Watch(shown)
