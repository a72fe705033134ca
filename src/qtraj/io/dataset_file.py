"""Save and load labelled datasets as netCDF, Zarr, Parquet or CSV, according to the suffix of the file.

All formats preserve floats exactly. netCDF and Zarr store any dataset unchanged. Parquet and CSV store one table: a row
for each instant of each path, a column for each component, and a header with all other data (see `qtraj.io.flat`).
pandas reads the table, and `load_dataset` restores the dataset. All four formats need the extra `io`, whose packages
are imported only when used.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from qtraj.foundation.extras import require_package
from qtraj.foundation.files import move, staging, sweep
from qtraj.foundation.untrusted import require_regular
from qtraj.io.damaged import reading

if TYPE_CHECKING:
    import xarray


class Labelled(Protocol):
    """A result that can be converted to a dataset, such as the table of `qtraj.evaluate`."""

    def to_xarray(self) -> "xarray.Dataset":
        """Convert the result to an `xarray.Dataset`."""
        ...


def save_dataset(dataset: "xarray.Dataset | Labelled", file: str | os.PathLike[str]) -> None:
    """Write a dataset, or a result with a method `to_xarray`, to a .nc, .zarr, .parquet or .csv file.

    `load_dataset` restores values, types, labels, units and all other attributes; floats are exact. The file (for Zarr,
    the folder) is written completely or not at all, and replaces an existing dataset with this name.

    **Raises:** ValueError for any other suffix, or values that the format cannot store; OSError if the file cannot be
    written; ModuleNotFoundError with the extra to install, if a package is missing.
    """
    path = Path(file)
    write = _by_suffix(path, _WRITERS)
    require_package("xarray", "saving a dataset")
    import xarray

    content = dataset if isinstance(dataset, xarray.Dataset) else dataset.to_xarray()
    if path.is_dir() and not _is_store(path):
        raise IsADirectoryError(f"{path}: this folder is not a Zarr store and is not replaced. Choose another name.")
    with staging(path.absolute().parent) as stage:
        write(content.drop_encoding(), stage / path.name)
        move(stage / path.name, path)


def load_dataset(file: str | os.PathLike[str]) -> "xarray.Dataset":
    """Load the dataset in a .nc, .zarr, .parquet or .csv file into memory.

    **Raises:** OSError if the file does not exist; ValueError with the name of the file for any other suffix, or if the
    file does not contain a dataset; ModuleNotFoundError with the extra to install, if a package is missing.
    """
    path = Path(file)
    read = _by_suffix(path, _READERS)
    require_package("xarray", "loading a dataset")
    if not path.exists():
        sweep(path.absolute().parent)  # restores a store if a process was killed while replacing it
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file")
    require_regular(path)
    return read(path)


def _write_netcdf(dataset: "xarray.Dataset", file: Path) -> None:
    require_package("h5netcdf", "saving netCDF")
    from qtraj.io.netcdf import write_netcdf

    write_netcdf(dataset, file)


def _read_netcdf(file: Path) -> "xarray.Dataset":
    require_package("h5netcdf", "loading netCDF")
    from qtraj.io.netcdf import read_netcdf

    return read_netcdf(file)


def _write_zarr(dataset: "xarray.Dataset", file: Path) -> None:
    require_package("zarr", "saving Zarr")
    from qtraj.io.zarr_store import write_zarr

    write_zarr(dataset, file)


def _read_zarr(file: Path) -> "xarray.Dataset":
    require_package("zarr", "loading Zarr")
    from qtraj.io.zarr_store import read_zarr

    return read_zarr(file)


def _write_parquet(dataset: "xarray.Dataset", file: Path) -> None:
    require_package("pyarrow", "saving Parquet")
    from qtraj.io.flat import flatten
    from qtraj.io.flat_parquet import write_parquet

    write_parquet(flatten(dataset), file)


def _read_parquet(file: Path) -> "xarray.Dataset":
    require_package("pyarrow", "loading Parquet")
    from qtraj.io.flat_parquet import read_parquet

    return _unfolded(read_parquet(file), file)


def _write_csv(dataset: "xarray.Dataset", file: Path) -> None:
    from qtraj.io.flat import flatten
    from qtraj.io.flat_csv import write_csv

    write_csv(flatten(dataset), file)


def _read_csv(file: Path) -> "xarray.Dataset":
    from qtraj.io.flat_csv import read_csv

    return _unfolded(read_csv(file), file)


def _unfolded(flat: Any, file: Path) -> "xarray.Dataset":
    from qtraj.io.flat import unflatten

    with reading(file, "a dataset: header and table do not match"):
        return unflatten(flat)


def _is_store(folder: Path) -> bool:
    return any((folder / name).is_file() for name in (".zgroup", "zarr.json"))


_WRITERS: dict[str, Callable[[Any, Path], None]] = {
    ".nc": _write_netcdf,
    ".zarr": _write_zarr,
    ".parquet": _write_parquet,
    ".csv": _write_csv,
}
_READERS: dict[str, Callable[[Path], Any]] = {
    ".nc": _read_netcdf,
    ".zarr": _read_zarr,
    ".parquet": _read_parquet,
    ".csv": _read_csv,
}
SUFFIXES = tuple(_READERS)
"""Suffixes of the files that can be loaded."""


def _by_suffix(path: Path, choices: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    try:
        return choices[path.suffix.lower()]
    except KeyError:
        raise ValueError(f"{path}: the name of a dataset file must end in {', '.join(choices)}") from None
