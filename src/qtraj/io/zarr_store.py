"""Read and write datasets as Zarr stores.

The stores use Zarr format 2, because format 3 does not yet specify fixed-length strings or consolidated metadata.
Every reader opens format 2 without a warning.
"""

from pathlib import Path
from typing import Any

import xarray

from qtraj.foundation.untrusted import parse_json, read_text
from qtraj.io.damaged import reading

METADATA = (".zarray", ".zmetadata", "zarr.json")


def write_zarr(dataset: xarray.Dataset, folder: Path) -> None:
    """Write a dataset as a new Zarr store without loss of precision; `xarray.open_zarr` reads it."""
    exact = {name: {"_FillValue": None} for name in dataset.variables if dataset[name].dtype.kind == "f"}
    dataset.to_zarr(folder, mode="w-", zarr_format=2, consolidated=True, encoding=exact)


def read_zarr(folder: Path) -> xarray.Dataset:
    """Read the dataset in a Zarr store.

    **Raises:** ValueError with the name of the folder if it is not a Zarr store, or contains pickled objects.
    """
    if any(map(_pickles, _metadata(folder))):
        raise ValueError(
            f"{folder}: this store contains pickled objects, which could run arbitrary code when they are read"
        )
    with reading(folder, "a Zarr store with a dataset"):
        return xarray.load_dataset(folder, engine="zarr", chunks=None)


def _metadata(folder: Path) -> list[Any]:
    documents = []
    for file in sorted(file for name in METADATA for file in folder.rglob(name)):
        text = read_text(file)
        try:
            documents.append(parse_json(text))
        except ValueError as error:
            raise ValueError(f"{file}: this metadata file cannot be read ({error})") from error
    return documents


def _pickles(value: Any) -> bool:
    """Return whether the metadata contain the name of a codec that unpickles objects."""
    if isinstance(value, dict):
        codec = any("pickle" in str(value.get(key, "")) for key in ("id", "name"))
        return codec or any(map(_pickles, value.values()))
    return isinstance(value, list) and any(map(_pickles, value))
