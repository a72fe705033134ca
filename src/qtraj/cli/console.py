"""Print to the terminal: without control characters of the input, and with one message if printing fails."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from qtraj.foundation.printable import has_control, one_line, printable

UNPRINTED = 1
"""Exit code if the results could not be printed."""

LONGEST = 2000
"""Maximum number of characters of a message: about a screenful."""


class PlainConsole(Console):
    r"""A console that prints control characters of texts as escape sequences of Python, such as `\x1b`.

    File names, keys and headers may contain them; printed as they are, they would control the terminal.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Return the segments of an object."""
        for segment in super().render(renderable, options):
            is_text = segment.control is None and has_control(segment.text)
            yield Segment(printable(segment.text), segment.style) if is_text else segment


def stdout() -> Console:
    """Return the console for results."""
    return PlainConsole(highlight=False)


def stderr() -> Console:
    """Return the console for progress, warnings and errors."""
    return PlainConsole(stderr=True, highlight=False)


def message(kind: str, text: str) -> None:
    """Print a message of one line to stderr, for example a warning; `kind` is its first word."""
    stderr().print(f"{kind}: {one_line(text, LONGEST)}", markup=False, soft_wrap=True)


@contextmanager
def printing() -> Iterator[None]:
    """Exit with one message if stdout cannot be written to, for example because the disk is full."""
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output has closed the pipe
        raise
    except OSError as error:
        _discard_stdout()
        message("error", f"the results could not be printed: {error.strerror or error}")
        raise SystemExit(UNPRINTED) from None


def _discard_stdout() -> None:
    """Redirect stdout, so that the rest of its buffer is not written when the process ends."""
    with suppress(OSError, ValueError):
        null: Any = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
