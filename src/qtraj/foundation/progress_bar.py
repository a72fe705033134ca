"""Show progress on a terminal, or as lines of a log (extra `cli`), for the command line and for scripts."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress as Bars, SpinnerColumn, TextColumn, TimeElapsedColumn

from qtraj.foundation.progress import Progress

EVERY = 5.0
"""Time [s] between two lines of a log."""


class Watch:
    """A display of the current activity and its progress; the base class displays nothing."""

    def say(self, text: str) -> None:
        """Show the current activity."""

    def tuning(self, progress: Progress) -> None:
        """Show the progress of `tune`."""
        self.working("tuning", progress)

    def working(self, activity: str, progress: Progress) -> None:
        """Show the progress of an activity."""


class BarWatch(Watch):
    """A progress bar on a terminal."""

    def __init__(self, shown: Bars):
        self._shown = shown
        self._task: Any = shown.add_task("", total=None)

    def say(self, text: str) -> None:
        """Show the current activity."""
        self._shown.update(self._task, description=text, completed=0)
        for task in self._shown.tasks:  # for `update`, None means the previous total
            task.total = task.finished_time = None

    def working(self, activity: str, progress: Progress) -> None:
        """Show the progress of an activity."""
        numbers = {"completed": progress.done, "total": progress.total}
        self._shown.update(self._task, description=f"{activity}: {progress}", **numbers)


class LogWatch(Watch):
    """Lines on stderr, one every few seconds; a short computation prints none."""

    def __init__(self) -> None:
        self._text, self._seconds = "", 0.0
        self._ended = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def say(self, text: str) -> None:
        """Show the current activity."""
        self._text = text

    def working(self, activity: str, progress: Progress) -> None:
        """Show the progress of an activity."""
        self._text = f"{activity}: {progress}"

    def end(self) -> None:
        """Print no more lines."""
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.wait(EVERY):
            self._seconds += EVERY
            sys.stderr.write(f"{self._text or 'working'} ({self._seconds:.0f} s)\n")
            sys.stderr.flush()


@contextmanager
def watching(quiet: bool = False) -> Iterator[Watch]:
    """Display progress on stderr: a bar on a terminal, which is erased at the end, and otherwise lines of a log.

    If `quiet` is true, nothing is printed.
    """
    if quiet:
        yield Watch()
        return
    console = Console(stderr=True, highlight=False)
    if not (console.is_terminal or console.is_jupyter):
        log = LogWatch()
        try:
            yield log
        finally:
            log.end()
        return
    text = TextColumn("{task.description}", markup=False)
    with Bars(SpinnerColumn(), text, BarColumn(20), TimeElapsedColumn(), console=console, transient=True) as shown:
        yield BarWatch(shown)
