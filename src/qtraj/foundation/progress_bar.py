"""Show progress on a terminal (extra `cli`), for the command line and for scripts."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress as Bars, SpinnerColumn, TextColumn, TimeElapsedColumn

from qtraj.foundation.progress import Progress


class Watch:
    """A progress display on a terminal; it prints nothing if there is no terminal."""

    def __init__(self, shown: Bars | None):
        self._shown = shown
        self._task: Any = None if shown is None else shown.add_task("", total=None)

    def say(self, text: str) -> None:
        """Show the current activity."""
        if self._shown is not None:
            self._shown.update(self._task, description=text, completed=0, total=None)

    def tuning(self, progress: Progress) -> None:
        """Show the progress of `tune`."""
        if self._shown is not None:
            numbers = {"completed": progress.done, "total": progress.total}
            self._shown.update(self._task, description=f"tuning: {progress}", **numbers)


@contextmanager
def watching() -> Iterator[Watch]:
    """Display progress on stderr with a `Watch`, and erase the display at the end.

    If stderr is not a terminal, nothing is printed.
    """
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        yield Watch(None)
        return
    text = TextColumn("{task.description}", markup=False)
    with Bars(SpinnerColumn(), text, BarColumn(20), TimeElapsedColumn(), console=console, transient=True) as shown:
        yield Watch(shown)
