"""Read files that may be damaged: every error of a library becomes one ValueError that names the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from qtraj.foundation.printable import one_line

LONGEST = 200
"""Maximum number of characters of a library's message."""


@contextmanager
def reading(file: Path, expected: str) -> Iterator[None]:
    """Convert every error inside the `with` block to a ValueError: `file` is not what was `expected`.

    Libraries raise errors of many types for damaged files. Errors that do not depend on the content are not converted:
    those of the operating system (an OSError with an `errno`), missing packages and exhausted memory.
    """
    try:
        yield
    except (MemoryError, ModuleNotFoundError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{file}: not {expected} ({fault(error)})") from error


def fault(error: BaseException) -> str:
    """Return the message of an error in one line, shortened, or its type if there is no message."""
    return one_line(str(error), LONGEST) or type(error).__name__
