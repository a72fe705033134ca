"""Write and read flat datasets as Parquet.

The schema metadata contain the header, and the column metadata contain the units.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from qtraj.foundation.untrusted import parse_json
from qtraj.io.damaged import reading
from qtraj.io.flat import FORMAT, Flat, require_header

KEY = b"qtraj"
NUMBER = {"attributes": {"units": "1", "long_name": "index, from 0"}}
"""Metadata of a column that contains the indices of paths or batch elements."""


def write_parquet(flat: Flat, file: Path) -> None:
    """Write columns and header; pandas and other Parquet readers can read the columns."""
    fields, arrays = [], []
    about = {column: v for v in flat.header["variables"].values() for column in v.get("columns", [])}
    for name, values in flat.columns.items():
        array = pa.array(values.tolist(), pa.string()) if values.dtype.kind == "U" else pa.array(values)
        notes = {key: str(value) for key, value in about.get(name, NUMBER)["attributes"].items()}
        fields.append(pa.field(name, array.type, metadata=notes))
        arrays.append(array)
    schema = pa.schema(fields, metadata={KEY: json.dumps(flat.header).encode()})
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), file)


def read_parquet(file: Path) -> Flat:
    """Read the columns and the header of a file.

    **Raises:** ValueError with the name of the file if the file is not Parquet or has no header.
    """
    with reading(file, "a Parquet file"):
        table = pq.read_table(file)
    with reading(file, "a Parquet file with a readable header"):
        header = parse_json((table.schema.metadata or {}).get(KEY, b"{}"))
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError(
            f"{file}: this Parquet file does not contain a qtraj dataset; pandas.read_parquet reads its columns"
        )
    with reading(file, "a dataset"):
        require_header(header)
        return Flat({name: _values(table.column(name)) for name in table.column_names}, header)


def _values(column: pa.ChunkedArray) -> np.ndarray:
    return np.array(column.to_pylist()) if pa.types.is_string(column.type) else column.to_numpy()
