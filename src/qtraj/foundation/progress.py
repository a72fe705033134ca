"""Progress reports of long computations, a few per second."""

import time
from collections.abc import Callable
from typing import NamedTuple

from typing_extensions import TypeAliasType

INTERVAL = 0.25
"""[s] Minimum time between two reports."""


class Progress(NamedTuple):
    """One report: what is being done (`text`), and `done` of `total` steps; `total` is None if unknown."""

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
"""A function that receives progress reports."""


def throttled(report: Report | None, interval: float = INTERVAL, clock: Callable[[], float] = time.monotonic) -> Report:
    """`report`, called at once and then at most every `interval` [s]; reports in between are dropped.

    If `report` is None, nothing is reported.
    """
    last = -float("inf")

    def limited(progress: Progress) -> None:
        nonlocal last
        now = clock()
        if report is not None and now - last >= interval:
            last = now
            report(progress)

    return limited
