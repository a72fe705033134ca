"""Add the location of an invalid input, such as a file or a key, to the error message."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Prepend `where`, such as the name of a file or a key, to the message of a ValueError from the `with` block.

    A message that already begins with `where`, or with the same file and a line, is unchanged.
    """
    named = (where, f"{where.rstrip(': ')}, ")
    try:
        yield
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(named) else f"{where}{error}") from error
