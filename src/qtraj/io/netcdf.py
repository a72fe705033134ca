"""Write and read netCDF files.

The HDF5 library may crash or never return if a file is damaged, or if the disk is full while it writes. So files are
created in memory, and files are read by a child process first, within a time limit.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import xarray

from qtraj.foundation.printable import one_line
from qtraj.io.damaged import LONGEST, reading

SECONDS, BYTES_PER_SECOND = 30.0, 5e6
"""The time limit of the child process: a constant, and a rate for large files."""

KILLS = {getattr(signal, name, 0) for name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")}
"""Signals that end a process from outside."""


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
    """Read the file in a child process, and raise a ValueError if this fails or does not end in time.

    **Raises:** OSError if the file cannot be opened.
    """
    with file.open("rb"):  # a missing permission is not a fault of the content
        pass
    limit = SECONDS + file.stat().st_size / BYTES_PER_SECOND
    command = [sys.executable, "-P", "-m", "qtraj.io.netcdf_probe", os.fspath(file.absolute())]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=limit, stdin=subprocess.DEVNULL, env=os.environ | _search_path()
        )
    except subprocess.TimeoutExpired:
        raise ValueError(
            f"{file}: reading the netCDF-4 file did not end within {limit:.0f} s: the file is damaged, or the disk or "
            "the computer is very slow; in the second case, try again"
        ) from None
    if done.returncode:
        raise ValueError(f"{file}: {_failure(done)}")


def _search_path() -> dict[str, str]:
    """Return the variable PYTHONPATH with the folder of qtraj at the end.

    Empty entries, which mean the current folder, are omitted.
    """
    entries = [*os.environ.get("PYTHONPATH", "").split(os.pathsep), os.fspath(Path(__file__).parents[2])]
    return {"PYTHONPATH": os.pathsep.join(filter(None, entries))}


def _failure(done: "subprocess.CompletedProcess[bytes]") -> str:
    """Return what happened to the child process: a fault of the file, a crash, or a process that was killed."""
    if found := done.stdout.decode(errors="replace").strip():
        return f"not a netCDF-4 file ({found})"
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    last = f" ({one_line(lines[-1], LONGEST)})" if lines else ""
    if done.returncode > 0:
        return f"the netCDF-4 file could not be examined, because the process for this failed{last}"
    if -done.returncode in KILLS:
        return (
            f"the netCDF-4 file could not be examined, because the process for this was killed{last}, perhaps because "
            "the memory was exhausted: free memory, and try again"
        )
    name = signal.Signals(-done.returncode).name
    return f"not a netCDF-4 file, or a damaged one: the HDF5 library crashed with {name}{last}"
