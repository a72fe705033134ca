"""Define the benchmarks of `python -m benchmarks`, one in each module; `measure(quick)` returns `Measured`."""

from typing import Any, NamedTuple

RACES = (
    "startup",
    "first_answers",
    "evaluation",
    "sizes",
    "memory",
    "bandwidth",
    "gradients",
    "trihedra",
    "rotations",
    "propagation",
    "spline",
    "tuning",
    "first_steps",
)
"""The modules `benchmarks.races.<name>`, in the order in which they run."""


class Measured(NamedTuple):
    """The rows of a table; all rows have the same keys, which form the header and contain the units."""

    title: str
    rows: list[dict[str, Any]]
    settings: dict[str, Any]
