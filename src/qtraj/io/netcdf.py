"""Write and read netCDF files.

The HDF5 library may crash or never return if a file is damaged, or if the disk is full while it writes. So files are
created in memory, and files are read by a child process first, within a time limit.
"""

import os
import subprocess
import sys
from pathlib import Path

import xarray

from qtraj.io.damaged import reading

SECONDS, BYTES_PER_SECOND = 10.0, 20e6
"""The time limit of the child process: a constant, and a rate for large files."""


def write_netcdf(dataset: xarray.Dataset, file: str | os.PathLike[str]) -> None:
    """Write a dataset as netCDF-4 without loss of precision; `xarray.open_dataset` reads it."""
    exact = {name: {"_FillValue": None} for name in dataset.variables if dataset[name].dtype.kind == "f"}
    Path(file).write_bytes(dataset.to_netcdf(engine="h5netcdf", encoding=exact))


def read_netcdf(file: Path) -> xarray.Dataset:
    """Read the dataset in a netCDF-4 file.

    **Raises:** ValueError with the name of the file if it is not a netCDF-4 file, or damaged.
    """
    _require_readable(file)
    with reading(file, "a netCDF-4 file"):
        return xarray.load_dataset(file, engine="h5netcdf")


def _require_readable(file: Path) -> None:
    """Read the file in a child process, and raise a ValueError if this fails or does not end in time."""
    limit = SECONDS + file.stat().st_size / BYTES_PER_SECOND
    command = [sys.executable, "-m", "qtraj.io.netcdf_probe", os.fspath(file.absolute())]
    source = os.fspath(Path(__file__).parents[2])
    path = os.pathsep.join([source, *filter(None, [os.environ.get("PYTHONPATH")])])
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=limit, stdin=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": path}
        )
    except subprocess.TimeoutExpired:
        raise ValueError(f"{file}: a damaged netCDF-4 file; reading it did not end within {limit:.0f} s") from None
    if done.returncode:
        fault = done.stdout.decode(errors="replace").strip() or "the HDF5 library crashed"
        raise ValueError(f"{file}: not a netCDF-4 file ({fault})")
