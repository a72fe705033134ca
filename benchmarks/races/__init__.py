"""What `python -m benchmarks` measures: one module for each race, with `measure(quick)` → `Found`."""

from typing import Any, NamedTuple

RACES = (
    "startup",
    "compilation",
    "operations",
    "evaluation",
    "sizes",
    "memory",
    "bandwidth",
    "gradients",
    "rotations",
    "propagation",
    "spline",
    "tuning",
)
"""In the order in which they run; `benchmarks.races.<name>`."""


class Found(NamedTuple):
    """The rows of a table, all with the same keys, which are its header; numbers with units in the keys."""

    title: str
    rows: list[dict[str, Any]]
    settings: dict[str, Any]
