"""Datasets over time, as commands and results make them, from plain arrays."""

from typing import NamedTuple

import numpy as np

from qtraj.foundation.record import Quantity, Record, to_dataset


class Column(NamedTuple):
    """One quantity over time: values (n,) or (n, m), unit, meaning, and for (n, m) the name of the second axis."""

    values: np.ndarray
    unit: str
    meaning: str
    axis: str | None = None


def instants_dataset(times, columns, attributes):
    """The columns over `times` (n,) [s]."""
    variables = {
        name: Quantity(x.values, x.unit, x.meaning, ("time",) if x.axis is None else ("time", x.axis))
        for name, x in columns.items()
    }
    time = Quantity(times, "s", "time from the start of the program", ("time",))
    return to_dataset(Record("", variables, {"time": time}, attributes))
