"""Progress of long work: a few reports a second, each with how much is done."""

import time
from collections.abc import Callable
from typing import NamedTuple

from typing_extensions import TypeAliasType

INTERVAL = 0.25
"""[s] Least time between two reports."""


class Progress(NamedTuple):
    """What is being done, and how much of it: `done` of `total`, whose total may not be known."""

    text: str
    done: int = 0
    total: int | None = None

    @property
    def fraction(self) -> float | None:
        """How much is done, from 0 to 1; None where the total is not known."""
        return None if self.total is None else min(self.done / max(self.total, 1), 1.0)

    def __str__(self) -> str:
        return self.text if self.total is None else f"{self.done} of {self.total} {self.text}"


Report = TypeAliasType("Report", Callable[[Progress], None])
"""What is told of progress."""


def throttled(report: Report | None, interval: float = INTERVAL, clock: Callable[[], float] = time.monotonic) -> Report:
    """`report`, called at once and then no more often than every `interval` [s]; what comes too soon is left out.

    Where nobody wants reports (None) nothing happens.
    """
    last = -float("inf")

    def tell(progress: Progress) -> None:
        nonlocal last
        now = clock()
        if report is not None and now - last >= interval:
            last = now
            report(progress)

    return tell
