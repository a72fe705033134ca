"""Convert a record over instants to a pandas DataFrame with flat column names."""

import itertools
from typing import TYPE_CHECKING

import numpy as np

from qtraj.foundation.record import LABELS, Quantity, Record

if TYPE_CHECKING:
    import pandas


def data_frame(record: Record, batch: str | None = None) -> "pandas.DataFrame":
    """Return one row for each instant of a record whose coordinate is `time`; `batch` is the name of the batch axis.

    A quantity with component axes has one column for each component, whose name ends in the labels of the axes.
    """
    import pandas

    time = record.coordinates["time"]
    rows = (batch, time.axes[-1]) if batch else time.axes
    sizes = {axis: n for q in record.everything().values() for axis, n in zip(q.axes, np.shape(q.values), strict=True)}
    shape = tuple(sizes[axis] for axis in rows)
    columns = {} if batch is None else {batch: np.indices(shape)[0].ravel()}
    columns["time"] = np.broadcast_to(np.asarray(time.values), shape).ravel()
    for name, quantity in record.variables.items():
        columns |= _columns(name, quantity, rows, record)
    return pandas.DataFrame(columns)


def _columns(name: str, quantity: Quantity, rows: tuple[str, ...], record: Record) -> dict[str, np.ndarray]:
    """Return the columns of a quantity by their names, in the order of its components."""
    others = [axis for axis in quantity.axes if axis not in rows]
    order = [quantity.axes.index(axis) for axis in (*others, *rows)]
    values = np.asarray(quantity.values).transpose(order)
    labels = [{**LABELS, **record.labels}[axis] for axis in others]
    parts = values.reshape(-1, *values.shape[len(others) :])
    return {"_".join([name, *label]): x.ravel() for label, x in zip(itertools.product(*labels), parts, strict=True)}
