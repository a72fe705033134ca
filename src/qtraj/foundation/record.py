"""Represent results as labelled arrays with units, which are the source of datasets, HTML tables and summaries."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from qtraj.foundation.arrays import is_traced
from qtraj.foundation.extras import require_package
from qtraj.foundation.provenance import provenance_attributes

if TYPE_CHECKING:
    import xarray

LABELS: dict[str, list[str]] = {
    "world": ["x", "y", "z"],
    "body": ["x", "y", "z"],
    "component": ["w", "x", "y", "z"],
    "friction_axis": ["along", "across"],
}
"""Labels of the component axes; the `labels` of a record override them."""

CONVENTIONS = {
    "quaternion_convention": "scalar first, Hamilton product, body to world",
    "frame_convention": "right-handed; world axes x, y, z with z up; rates and accelerations of attitudes in body axes",
}
"""Attributes of every dataset; the `attributes` of a record override them."""


class Quantity(NamedTuple):
    """A labelled array: values, unit, meaning, and the names of its axes after the batch axes.

    The unit is in netCDF notation ("m s-2"). It is "1" for dimensionless numbers, and empty for strings and for
    numbers whose `meaning` contains the unit.
    """

    values: Any
    unit: str
    meaning: str
    axes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Record:
    """Contents of a result as labelled quantities.

    `summary` is one line of text, `attributes` describe the whole record, and `labels` name the entries along the
    component axes. If a quantity has more dimensions than names in `axes`, the first dimensions are batch axes. A
    quantity may have fewer batch axes than the record; its batch axes are then the last batch axes of the record.
    """

    summary: str
    variables: Mapping[str, Quantity]
    coordinates: Mapping[str, Quantity] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)
    labels: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def everything(self) -> dict[str, Quantity]:
        """Return coordinates and variables in one dict."""
        return {**self.coordinates, **self.variables}

    def dims(self, quantity: Quantity) -> tuple[str, ...]:
        """Return the names of the dimensions of `quantity`: the batch axes, then `quantity.axes`.

        The name of a batch axis is `batch`, or `batch_1`, `batch_2`, … if the record has several batch axes.
        """
        n_batch = max(_batch_axes(each) for each in self.everything().values())
        names = ("batch",) if n_batch == 1 else tuple(f"batch_{k + 1}" for k in range(n_batch))
        return (*names[n_batch - _batch_axes(quantity) :], *quantity.axes)


def to_dataset(record: Record, attributes: Mapping[str, Any] | None = None) -> "xarray.Dataset":
    """Convert the record to an `xarray.Dataset`.

    The attributes of the dataset are the conventions, the provenance, the attributes of the record, and `attributes`.
    If several attributes have the same name, the last value is used.

    **Raises:** ModuleNotFoundError with the extra `io` to install, if xarray is missing.
    """
    require_package("xarray", "a labelled dataset")
    import xarray

    concrete = {name: q._replace(values=np.asarray(q.values)) for name, q in record.everything().items()}
    variables, coordinates = (
        {
            name: (record.dims(q), concrete[name].values, variable_attributes(q.unit, q.meaning))
            for name, q in part.items()
        }
        for part in (record.variables, record.coordinates)
    )
    used = {dim for dims, *_ in variables.values() for dim in dims}
    labels = {axis: list(names) for axis, names in {**LABELS, **record.labels}.items() if axis in used}
    dtypes = [q.values.dtype for q in concrete.values() if q.values.dtype.kind == "f"]
    provenance = provenance_attributes(np.result_type(*dtypes) if dtypes else np.dtype(float))
    everything = CONVENTIONS | provenance | dict(record.attributes) | dict(attributes or {})
    return xarray.Dataset(variables, {**coordinates, **labels}, everything)


def variable_attributes(unit: str, meaning: str) -> dict[str, Any]:
    """Return the attributes of a variable; an empty unit is omitted."""
    return {**({"units": unit} if unit else {}), "long_name": meaning}


def require_concrete(values: Any) -> None:
    """Raise a ValueError if any array in a tree is traced."""
    if is_traced(values):
        raise ValueError("a dataset needs concrete values, but these are traced: create it outside jit, grad and vmap")


def _batch_axes(quantity: Quantity) -> int:
    return np.ndim(quantity.values) - len(quantity.axes)
