"""The lines of a text file with their numbers, without blank lines and comments; a line is decoded when it is used."""

import codecs
from collections.abc import Iterator, Sequence
from typing import Any, overload

import numpy as np

COMMENTS = ("#", "%", "//")
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""The first bytes of a text in UTF-16, such as the "Unicode text" of Excel."""

BLOCK = 4096
"""Number of lines that are decoded at once."""

_MARKS = tuple(mark.encode() for mark in COMMENTS)


class Lines(Sequence[tuple[int, str]]):
    """Pairs of a line number and a line, in little memory: the bytes of the file, and where each line starts and ends.

    A recording may have millions of lines, of which most are only read as numbers.
    """

    def __init__(self, content: bytes, starts: np.ndarray, ends: np.ndarray, numbers: np.ndarray):
        self._content, self._starts, self._ends, self._numbers = content, starts, ends, numbers

    @overload
    def __getitem__(self, index: int) -> tuple[int, str]: ...
    @overload
    def __getitem__(self, index: slice) -> "Lines": ...
    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return Lines(self._content, self._starts[index], self._ends[index], self._numbers[index])
        return int(self._numbers[index]), self._content[self._starts[index] : self._ends[index]].decode()

    def __len__(self) -> int:
        return len(self._numbers)

    def __iter__(self) -> Iterator[tuple[int, str]]:
        return zip(self._numbers.tolist(), self.texts(), strict=True)

    def texts(self) -> Iterator[str]:
        """Return the lines without their numbers; lines that follow each other in the file are decoded at once."""
        for k in range(0, len(self), BLOCK):
            starts, ends = self._starts[k : k + BLOCK], self._ends[k : k + BLOCK]
            if (starts[1:] == ends[:-1] + 1).all():
                yield from self._content[starts[0] : ends[-1]].decode().split("\n")
            else:
                yield from (self._content[a:b].decode() for a, b in zip(starts.tolist(), ends.tolist(), strict=True))

    def counts(self, letter: str) -> np.ndarray:
        """Return how often an ASCII letter occurs in each line."""
        counts = np.zeros(len(self), np.int32)
        for k in range(0, len(self), BLOCK):
            starts, ends = self._starts[k : k + BLOCK], self._ends[k : k + BLOCK]
            letters = np.frombuffer(self._content, np.uint8, ends[-1] - starts[0], starts[0])
            places = np.flatnonzero(letters == ord(letter)) + starts[0]
            counts[k : k + BLOCK] = np.searchsorted(places, ends) - np.searchsorted(places, starts)
        return counts

    def total(self, letter: str) -> int:
        """Return how often an ASCII letter occurs from the first to the last line, comments between them included."""
        return self._content.count(letter.encode(), int(self._starts[0]), int(self._ends[-1])) if len(self) else 0

    def contains(self, letter: str) -> bool:
        """Return whether the file contains an ASCII letter."""
        return letter.encode() in self._content


def split_lines(text: str) -> tuple[Lines, Lines]:
    """Return the comments and the other lines of a text, both without blank lines."""
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    content = text.encode()
    breaks = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n"))
    starts = np.concatenate([[0], breaks + 1]).astype(np.int64)
    ends = np.append(breaks, len(content)).astype(np.int64)
    full = ends > starts
    lines = Lines(content, starts[full], ends[full], np.flatnonzero(full) + 1)
    kinds = _kinds(content, lines._starts, lines._ends)
    return tuple(
        Lines(content, lines._starts[kinds == kind], lines._ends[kinds == kind], lines._numbers[kinds == kind])
        for kind in (1, 0)
    )  # pyright: ignore[reportReturnType]


def _kinds(content: bytes, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return 0 for lines with cells, 1 for comments and 2 for blank lines."""
    letters = np.frombuffer(content, np.uint8)
    if not len(starts):
        return np.zeros(0, int)
    unusual = np.flatnonzero(np.isin(letters[starts], list(b" \t\v\f#%/")))
    kinds = np.zeros(len(starts), int)
    for k in unusual.tolist():
        line = content[starts[k] : ends[k]].strip()
        kinds[k] = 1 if line.startswith(_MARKS) else 0 if line else 2
    return kinds
