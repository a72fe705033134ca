"""Report the progress of long computations, a few times per second."""

import time
from collections.abc import Callable
from typing import NamedTuple

from typing_extensions import TypeAliasType

INTERVAL = 0.25
"""Minimum time [s] between two reports."""


class Progress(NamedTuple):
    """One report: activity `text`, number of completed steps `done`, and number of steps `total`, None if unknown."""

    text: str
    done: int = 0
    total: int | None = None

    @property
    def fraction(self) -> float | None:
        """The completed fraction, from 0 to 1; None if the total is unknown."""
        return None if self.total is None else min(self.done / max(self.total, 1), 1.0)

    def __str__(self) -> str:
        return self.text if self.total is None else f"{self.done} of {self.total} {self.text}"


Report = TypeAliasType("Report", Callable[[Progress], None])
"""A function that is called with progress reports."""


def throttled(report: Report | None, interval: float = INTERVAL, clock: Callable[[], float] = time.monotonic) -> Report:
    """Return a function that calls `report` at most once per `interval` [s].

    Other reports are dropped. If `report` is None, all reports are dropped.
    """
    last = -float("inf")

    def limited(progress: Progress) -> None:
        nonlocal last
        now = clock()
        if report is not None and now - last >= interval:
            last = now
            report(progress)

    return limited
