"""Columns of numbers as a text file."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray

SYMBOLS = {"1": "", "rad": "rad", "rad s-1": "rad/s", "rad s-2": "rad/s²", "s-1": "1/s", "s-2": "1/s²"}
"""Units of datasets over instants as people write them."""


def write_csv(columns: Mapping[str, np.ndarray], headers: Mapping[str, Sequence[str]], file: Path) -> None:
    """The columns that `headers` names, (n,) or (n, m) with a header for each component, floats exactly."""
    parts = [np.asarray(columns[name], dtype=float) for name in headers]
    table = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
    header = ",".join(name for names in headers.values() for name in names)
    rows = (",".join(map(repr, row)) for row in table.tolist())
    file.write_text("\n".join([header, *rows, ""]), encoding="utf-8")


def csv_headers(dataset: xarray.Dataset) -> dict[str, list[str]]:
    """The columns of a dataset over instants: name_component [unit], such as rate_x [rad/s]."""
    headers = {"time": ["time [s]"]}
    for name, variable in dataset.data_vars.items():
        unit = SYMBOLS[variable.attrs["units"]]
        components = [f"_{label}" for label in dataset[variable.dims[1]].values] if variable.ndim > 1 else [""]
        headers[str(name)] = [f"{name}{component}{f' [{unit}]' if unit else ''}" for component in components]
    return headers
