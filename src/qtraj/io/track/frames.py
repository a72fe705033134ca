"""Read tables of pandas, polars and xarray, without an import of these libraries."""

from typing import Any

import numpy as np

from qtraj.io.track.column_names import find
from qtraj.io.track.column_table import ColumnTable
from qtraj.io.track.known_names import COMMON, MORE

LIBRARIES = ("pandas", "polars", "xarray")


def is_frame(table: Any) -> bool:
    """Return whether an object is a data frame of pandas or polars, or a dataset of xarray."""
    name = type(table).__module__.split(".")[0]
    return name in LIBRARIES and type(table).__name__ in ("DataFrame", "LazyFrame", "Dataset")


def table_of(table: Any) -> ColumnTable:
    """Return the columns of a table as arrays.

    A named index, or one of dates, is a column, too; so are floating-point numbers without a name, if no column has
    times. Components of an xarray variable, such as `position` along the
    coordinate `world`, are columns with the names of the components.

    **Raises:** ValueError for repeated names, and for a dataset whose variables have no common first dimension.
    """
    library = type(table).__module__.split(".")[0]
    if library == "xarray":
        return ColumnTable(_of_dataset(table))
    if library == "polars":
        frame = table.collect() if hasattr(table, "collect") else table
        return ColumnTable({str(name): _plain(frame[name].to_numpy()) for name in frame.columns})
    names, columns = [_name(name) for name in table.columns], [table.iloc[:, k] for k in range(table.shape[1])]
    index = table.index
    if index.name is not None or _is_time(getattr(index.dtype, "kind", ""), names):
        names, columns = [_name(index.name or "time"), *names], [index.to_series(), *columns]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(
            f"the table has several columns with the name {repeated[0]!r}: rename or drop all but one of them"
        )
    return ColumnTable({name: _of_series(column) for name, column in zip(names, columns, strict=True)})


def _is_time(kind: str, names: list[str]) -> bool:
    """Return whether an index without a name is the time; `kind` is the kind of its NumPy type."""
    return kind in ("M", "m") or (kind == "f" and find((*COMMON["time"], *MORE["time"]), names) is None)


def _name(name: Any) -> str:
    """Return the name of a column; the levels of a pandas index of columns are joined."""
    return "_".join(str(part) for part in name if str(part)) if isinstance(name, tuple) else str(name)


def _of_series(series: Any) -> np.ndarray:
    """Return the values of a pandas series; dates in UTC."""
    if getattr(series.dtype, "tz", None) is not None:
        return series.dt.tz_convert("UTC").dt.tz_localize(None).to_numpy()
    return _plain(series.to_numpy())


def _plain(values: np.ndarray) -> np.ndarray:
    """Return booleans and other values as objects, so that they are not read as numbers."""
    return values if values.dtype.kind in "iufMm" else values.astype(object)


def _of_dataset(dataset: Any) -> dict[str, np.ndarray]:
    """Return each variable along the first common dimension, and each component of the variables with two."""
    variables = {str(name): dataset[name] for name in [*dataset.coords, *dataset.data_vars]}
    dims = [str(array.dims[0]) for array in variables.values() if len(array.dims)]
    main = "time" if "time" in dims else max(dims, key=dims.count, default="")
    columns: dict[str, np.ndarray] = {}
    for name, array in variables.items():
        if array.dims == (main,):
            columns[_with_unit(name, array)] = _plain(array.to_numpy())
        elif len(array.dims) == 2 and array.dims[0] == main:
            columns |= _components(name, array)
    if not columns:
        raise ValueError(
            "the xarray dataset has no variables along a common first dimension, such as time: a track needs times "
            "and positions"
        )
    return columns


def _components(name: str, array: Any) -> dict[str, np.ndarray]:
    dim = array.dims[1]
    labels = array[dim].to_numpy().tolist() if dim in array.coords else list(range(array.shape[1]))
    if labels == list(range(array.shape[1])) and array.shape[1] == 3:
        labels = ["x", "y", "z"]
    values = _plain(array.to_numpy())
    return {_with_unit(f"{name}_{label}", array): values[:, k] for k, label in enumerate(labels)}


def _with_unit(name: str, array: Any) -> str:
    """Return the name of a column with the unit of the xarray variable, if it has one."""
    unit = str(array.attrs.get("units", "")).partition(" since ")[0]
    return name if unit in ("", "1", "-") else f"{name} [{unit}]"
