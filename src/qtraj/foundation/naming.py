"""Errors that say where in the input their cause stands."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Put `where`, such as a file or a key, in front of the message of a ValueError."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}{error}") from error
