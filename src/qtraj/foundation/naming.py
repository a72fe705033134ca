"""Add the place in the input to error messages."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Prepend `where`, such as a file or a key, to the message of a ValueError."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}{error}") from error
