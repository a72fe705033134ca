"""Read files that may be damaged: every error of a library becomes one ValueError that names the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LONGEST = 200
"""Maximum number of characters of a library's message."""


@contextmanager
def reading(file: Path, expected: str) -> Iterator[None]:
    """Convert every error inside the `with` block to a ValueError: `file` is not what was `expected`.

    Libraries raise errors of many types for damaged files. OSErrors of the operating system are not converted, because
    they do not depend on the content.
    """
    try:
        yield
    except (PermissionError, IsADirectoryError, ModuleNotFoundError):
        raise
    except Exception as error:
        raise ValueError(f"{file}: not {expected} ({one_line(error)})") from error


def one_line(error: BaseException) -> str:
    """Return the message of an error in one line, shortened, or its type if there is no message."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
