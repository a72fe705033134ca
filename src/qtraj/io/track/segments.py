"""Divide a recording where its clock jumps back, or where its file begins a new segment."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from qtraj.io.track.time_column import Table

HOW = " (in a scenario segment under [track], on the command line --segment)"
MOST = 20
"""Largest number of jumps of the clock that are listed; a recording with more of them is not sorted."""


class Segment(NamedTuple):
    """A part of a recording: its first row, the row after its last row, the number of all segments, and its number."""

    start: int
    stop: int
    segments: int
    number: int | None = None


def choose_segment(
    path: Path | str, table: Table, name: str, times: np.ndarray, breaks: Sequence[int], segment: int | None
) -> Segment:
    """Return the rows of a segment, or all rows if `segment` is None.

    A segment begins at each of the rows `breaks`, and where a time (n,) is smaller than the time before.

    **Raises:** ValueError for times that decrease, without `segment`, and for a segment that does not exist.
    """
    jumps = (np.flatnonzero(np.diff(times) < 0) + 1).tolist()
    bounds = sorted({0, len(times), *jumps, *breaks})
    count = len(bounds) - 1
    if segment is not None:
        if not 1 <= segment <= count:
            raise ValueError(f"{path}: segment={segment} was given, but the recording has {_segments(count)}")
        return Segment(bounds[segment - 1], bounds[segment], count, segment)
    if jumps:
        raise ValueError(_decreasing(path, table, name, jumps, bounds))
    return Segment(0, len(times), count)


def _decreasing(path: Path | str, table: Table, name: str, jumps: list[int], bounds: list[int]) -> str:
    cells = [
        table.row(k)[table.header.index(name)].strip() if name in table.header else "" for k in (jumps[0], jumps[0] - 1)
    ]
    what = (
        f"{path}, {table.place(jumps[0])}: times must increase strictly, but in column {name!r} {cells[0]} follows "
        f"{cells[1]}"
    )
    if len(jumps) > MOST:
        return f"{what}, and the times decrease at {len(jumps)} places: sort the rows by their times"
    listed = ", ".join(
        f"segment={k + 1} ({table.place(a)} to {table.place(b - 1)})"
        for k, (a, b) in enumerate(pairwise(bounds[: MOST + 1]))
    )
    return f"{what}. The clock jumps back there, which divides the recording: pass {listed}{HOW}"


def _segments(count: int) -> str:
    return "1 segment" if count == 1 else f"{count} segments"
