"""The benchmarks of `python -m benchmarks`: one module for each, with `measure(quick)` → `Measured`."""

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
    "trihedra",
    "rotations",
    "propagation",
    "spline",
    "tuning",
)
"""The modules `benchmarks.races.<name>`, in the order in which they run."""


class Measured(NamedTuple):
    """The rows of a table, all with the same keys, which are its header; numbers with units in the keys."""

    title: str
    rows: list[dict[str, Any]]
    settings: dict[str, Any]
