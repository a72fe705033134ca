"""Quantities over instants as labelled data: what `qtraj turn` and `qtraj track` write as netCDF."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray

from qtraj.foundation.provenance import provenance_attributes
from qtraj.foundation.record import CONVENTIONS, LABELS, variable_attributes

RATES = {"rate_convention": "body axes; a virtual rate is d/dt ln|quaternion|²"}


class Column(NamedTuple):
    """One quantity: values (n,) or (n, m), unit as netCDF writes it, meaning, and of (n, m) the axis in `LABELS`."""

    values: np.ndarray
    unit: str
    meaning: str
    axis: str | None = None


def instants_dataset(
    times: np.ndarray,
    columns: Mapping[str, Column],
    attributes: Mapping[str, Any] | None = None,
    limits: Mapping[str, Any] | None = None,
) -> xarray.Dataset:
    """The columns over `times` (n,) [s], with units, meanings and conventions in the attributes (extra `io`).

    A column that `limits` names holds its bound, or one for each component, as attribute `limit`.
    """
    variables: dict[str, Any] = {}
    for name, column in columns.items():
        axes = () if column.axis is None else (column.axis,)
        variables[name] = (("time", *axes), column.values, variable_attributes(column.unit, column.meaning))
    for name, limit in (limits or {}).items():
        variables[name][2]["limit"] = limit
    used = {column.axis for column in columns.values()}
    coordinates: dict[str, Any] = {axis: labels for axis, labels in LABELS.items() if axis in used}
    coordinates["time"] = ("time", times, variable_attributes("s", "time from the start of the program"))
    whole = {**CONVENTIONS, **RATES, **provenance_attributes(np.asarray(times).dtype)}
    return xarray.Dataset(variables, coordinates, whole | dict(attributes or {}))
