"""Convert a dataset to one table with a header, the form of Parquet and CSV files, and back.

The table has one row for each combination of indices along the dimensions of `time` and the batch dimensions (`path`,
`batch`, `batch_1`, `batch_2`, …), in the order of the dimensions of the dataset. Paths and batch elements without names
have a column with their indices, starting from 0. A variable with more dimensions has one column for each component
(`position_x`, `dcm_tangent_x`). A variable with fewer dimensions is repeated (`duration` in each row of its path). A
dataset without these dimensions has one row for each index of its first dimension, and a dataset of scalars has one
row. Data that do not depend on the rows (the names of axes, a recording) are stored in the header, together with all
dimensions, types, units and other attributes.
"""

import itertools
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray

FORMAT = "qtraj-dataset/1"
TEXT, NUMBERS = "str", "int64"
KINDS = "fiub"
BATCH = re.compile(r"(?:batch|lane)(_\d+)?")
"""Names of the batch dimensions of results; earlier versions called them `lane`."""


@dataclass(frozen=True)
class Flat:
    """Columns (n,) by name, and a header that consists of JSON types."""

    columns: dict[str, np.ndarray]
    header: dict[str, Any]


def flatten(dataset: xarray.Dataset) -> Flat:
    """Convert a dataset to a table and a header.

    **Raises:** ValueError for an empty dataset, values that are neither numbers nor strings, and attributes that JSON
    cannot represent.
    """
    rows = _rows(dataset)
    columns, numbers = _numbers(dataset, rows)
    variables: dict[str, Any] = {}
    for key, variable in dataset.variables.items():
        name = str(key)
        about: dict[str, Any] = {"dims": [str(dim) for dim in variable.dims], "dtype": _kind(variable, name)}
        about |= {"coordinate": key in dataset.coords, "attributes": _plain(variable.attrs, name)}
        values = variable.values.astype(str) if about["dtype"] == TEXT else variable.values
        if not dataset.sizes or set(rows) & set(variable.dims):
            others = [dim for dim in variable.dims if dim not in rows]
            names = _names(dataset, name, others, columns)
            parts = _spread(xarray.Variable(variable.dims, values), rows, dataset.sizes, others)
            columns |= dict(zip(names, parts, strict=True))
            about["columns"] = names
        else:
            about["values"] = values.ravel().tolist()
        variables[name] = about
    header = {"format": FORMAT, "rows": list(map(str, rows))}
    header |= {"dimensions": {str(dim): n for dim, n in dataset.sizes.items()}}
    header |= {"numbers": numbers} if numbers else {}
    header |= {"attributes": _plain(dataset.attrs, "the dataset"), "variables": variables}
    return Flat(columns, header)


def unflatten(flat: Flat) -> xarray.Dataset:
    """Restore the dataset from a table and its header.

    **Raises:** KeyError or ValueError if table and header do not match.
    """
    rows, sizes = flat.header["rows"], flat.header["dimensions"]
    variables, coordinates = {}, {}
    for name, about in flat.header["variables"].items():
        if "columns" in about:
            values = _gathered(about, flat.columns, rows, sizes)
        else:
            values = np.array(about["values"], about["dtype"]).reshape([sizes[dim] for dim in about["dims"]])
        (coordinates if about["coordinate"] else variables)[name] = (about["dims"], values, about["attributes"])
    return xarray.Dataset(variables, coordinates, flat.header["attributes"])


def require_header(header: Any) -> None:
    """Raise a ValueError if an entry that `unflatten` reads is missing or has the wrong type."""
    expected = {"rows": list, "dimensions": dict, "variables": dict, "attributes": dict}
    complete = isinstance(header, dict) and all(isinstance(header.get(key), kind) for key, kind in expected.items())
    if not complete or not isinstance(header.get("numbers", {}), dict):
        raise ValueError(f"the header must be a JSON object with the keys {', '.join(expected)}")
    for name, about in header["variables"].items():
        parts = {"dims": list, "dtype": str, "coordinate": bool, "attributes": dict}
        if not isinstance(about, dict) or not all(isinstance(about.get(key), kind) for key, kind in parts.items()):
            raise ValueError(f"the header entry of {name!r} must contain {', '.join(parts)}")
        if not isinstance(about.get("columns", about.get("values")), list):
            raise ValueError(f"the header entry of {name!r} must contain a list of its columns or values")


def kinds(header: dict[str, Any]) -> dict[str, str]:
    """Return the type of the values of each column, as stated in the header of a table."""
    types = {column: about["dtype"] for about in header["variables"].values() for column in about.get("columns", [])}
    return dict.fromkeys(header.get("numbers", {}), NUMBERS) | types


def _rows(dataset: xarray.Dataset) -> list[Any]:
    """Return the dimensions over which the rows of the table extend."""
    if not dataset.variables:
        raise ValueError("an empty dataset cannot be written as a table: save it as .nc or .zarr")
    batch_dims = [dim for dim in dataset.sizes if _is_batch(dim)]
    if "time" not in dataset.variables:
        return batch_dims or list(dataset.sizes)[:1]
    return [dim for dim in dataset.sizes if dim in batch_dims or dim in dataset["time"].dims]


def _numbers(dataset: xarray.Dataset, rows: list[Any]) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the index columns of unnamed paths and batch elements, and the dimension of each of these columns."""
    shape = [dataset.sizes[dim] for dim in rows]
    columns, numbers = {}, {}
    for k, dim in enumerate(rows):
        if _is_batch(dim) and dim not in dataset.variables:
            columns[str(dim)] = np.indices(shape)[k].ravel().astype(NUMBERS)
            numbers[str(dim)] = str(dim)
    return columns, numbers


def _is_batch(dim: Any) -> bool:
    return dim == "path" or BATCH.fullmatch(str(dim)) is not None


def _spread(
    variable: xarray.Variable, rows: list[Any], sizes: Mapping[Any, int], others: list[Any]
) -> list[np.ndarray]:
    """Repeat a variable over all rows of the table, and return one array for each of its components."""
    own = [dim for dim in rows if dim in variable.dims]
    count = math.prod(sizes[dim] for dim in others)
    values = variable.transpose(*own, *others).values
    wide = values.reshape(*(sizes[dim] if dim in own else 1 for dim in rows), count)
    wide = np.broadcast_to(wide, (*(sizes[dim] for dim in rows), count))
    return [np.ascontiguousarray(wide[..., k]).ravel() for k in range(count)]


def _gathered(
    about: dict[str, Any], columns: dict[str, np.ndarray], rows: list[str], sizes: dict[str, int]
) -> np.ndarray:
    """Return the values of one variable from its columns, with the dimensions in their original order."""
    dims: list[str] = about["dims"]
    own, others = [dim for dim in rows if dim in dims], [dim for dim in dims if dim not in rows]
    wide = [columns[name].reshape([sizes[dim] for dim in rows]) for name in about["columns"]]
    first = np.stack(wide, axis=-1)[tuple(slice(None) if dim in own else 0 for dim in rows)]
    values = first.reshape([sizes[dim] for dim in (*own, *others)])
    return np.transpose(values, [[*own, *others].index(dim) for dim in dims]).astype(about["dtype"])


def _names(dataset: xarray.Dataset, name: str, others: list[Any], taken: dict[str, Any]) -> list[str]:
    """Return column names for the components of one variable, all different from the names in `taken`."""
    # For a dimension without labels, xarray returns indices.
    labels = [[str(label) for label in dataset[dim].values] for dim in others]
    names = []
    for parts in itertools.product(*labels):
        column = "_".join([name, *parts])
        while column in taken or column in names:
            column += "_"
        names.append(column)
    return names


def _kind(variable: xarray.Variable, name: str) -> str:
    """Return the type of the values: the name of a NumPy number type, or `TEXT`."""
    if variable.dtype.kind in KINDS and variable.dtype.itemsize <= 8:
        return str(variable.dtype.newbyteorder("="))
    texts = variable.dtype.kind in "UT" or all(isinstance(value, str) for value in variable.values.ravel().tolist())
    if variable.dtype.kind in "UTO" and texts:
        return TEXT
    raise ValueError(f"{name!r} has {variable.dtype} values, which a table cannot store: save it as .nc or .zarr")


def _plain(attributes: Any, name: str) -> dict[str, Any]:
    """Convert attributes to JSON types; NumPy numbers and arrays become plain numbers and lists."""
    try:
        return json.loads(json.dumps({str(key): value for key, value in attributes.items()}, default=_item))
    except (TypeError, ValueError) as error:
        raise ValueError(f"an attribute of {name} cannot be written as JSON: {error}") from error


def _item(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is neither a number nor a string")
