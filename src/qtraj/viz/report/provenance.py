"""Create the table with the provenance and the conventions of a report."""

import numpy as np
import xarray

from qtraj._version import __version__
from qtraj.viz.report.model import Table, words

SHOWN_ELSEWHERE = (
    "title",
    "tuning_result",
    "route_result",
    "retiming_result",
    "tuning_warning",
    "result",
    "closed_form",
)
"""Attributes that are in another part of the report."""


def provenance_table(dataset: xarray.Dataset) -> Table:
    """Tabulate the attributes of a dataset, with its conventions, and the version of qtraj that wrote the report."""
    rows = [
        [str(name).replace("_", " "), words(_text(value)) if str(name).endswith("_convention") else _text(value)]
        for name, value in dataset.attrs.items()
        if name not in SHOWN_ELSEWHERE and not str(name).startswith("fit_")
    ]
    return Table("Provenance and conventions", ["", ""], [*rows, ["report", f"qtraj {__version__}"]], numbers=2)


def _text(value: object) -> str:
    return ", ".join(map(str, value.tolist())) if isinstance(value, np.ndarray) else str(value)
