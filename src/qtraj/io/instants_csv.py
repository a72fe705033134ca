"""Write a dataset over instants as CSV for spreadsheets, with names and units in the header row."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np
import xarray

from qtraj.foundation.units import symbol

PATH_HEADERS = {
    "time": ["time [s]"],
    "position": ["x [m]", "y [m]", "z [m]"],
    "velocity": ["vx [m/s]", "vy [m/s]", "vz [m/s]"],
    "acceleration": ["ax [m/s²]", "ay [m/s²]", "az [m/s²]"],
    "speed": ["speed [m/s]"],
    "curvature": ["curvature [1/m]"],
    "torsion": ["torsion [1/m]"],
    "quaternion": ["qw", "qx", "qy", "qz"],
}
"""Column headers of a path, except for the angular rate, because its headers depend on the frame.

`qtraj.read_track` recognises the columns of time, position, velocity and attitude by these names."""


def write_csv(columns: Mapping[str, np.ndarray], headers: Mapping[str, Sequence[str]], file: Path) -> None:
    """Write the columns named in `headers` as exact floats; an array (n, m) needs m headers, and (n,) one."""
    parts = [np.asarray(columns[name], dtype=float) for name in headers]
    table = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
    header = ",".join(name for names in headers.values() for name in names)
    rows = (",".join(map(repr, row)) for row in table.tolist())
    file.write_text("\n".join([header, *rows, ""]), encoding="utf-8")


def csv_headers(dataset: xarray.Dataset) -> dict[str, list[str]]:
    """Return the column headers of a dataset over instants: name_component [unit], such as rate_x [rad/s]."""
    headers = {"time": ["time [s]"]}
    for name, variable in dataset.data_vars.items():
        unit = symbol(variable.attrs["units"])
        components = product(*(map(str, dataset[axis].values) for axis in variable.dims[1:]))  # may be indices
        headers[str(name)] = ["_".join([str(name), *labels]) + (f" [{unit}]" if unit else "") for labels in components]
    return headers


def path_headers(dataset: xarray.Dataset, others: Sequence[str]) -> dict[str, list[str]]:
    """Return the column headers of a path: `PATH_HEADERS`, the angular rate, and the variables `others`."""
    headers = csv_headers(dataset)
    return PATH_HEADERS | {name: headers[name] for name in ("rate", *others) if name not in PATH_HEADERS}
