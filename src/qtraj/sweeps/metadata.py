"""Write the metadata of the arrays of a sweep, with units and provenance, so that Zarr and xarray read its store."""

import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.provenance import provenance_attributes
from qtraj.foundation.record import variable_attributes
from qtraj.sweeps.outputs import STATUSES, Output
from qtraj.sweeps.store import Store

STATUS = "status"
"""The array with the status of each point."""

STATUS_OUTPUT = Output("|i1", ())


def write_metadata(
    store: Store,
    arrays: Mapping[str, Output],
    parameters: Sequence[str],
    about: Mapping[str, Mapping[str, Any]],
    attributes: Mapping[str, Any],
) -> None:
    """Create the Zarr group with its arrays, which have no chunks yet.

    `about`: attributes of arrays by name, such as units. `attributes`: attributes of the group.
    """
    import zarr  # imported here, because it delays the import of qtraj
    from zarr.storage import LocalStore

    made = provenance_attributes(np.dtype(float))
    made["coordinates"] = " ".join(parameters)
    for left in (*store.folder.glob("*.partial"), *store.folder.glob("*/*.partial")):  # by Zarr, when it was killed
        left.unlink()
    target = LocalStore(Path(store.folder))
    zarr.open_group(target, mode="a", zarr_format=3).attrs.put({**made, **attributes})
    for name, output in arrays.items():
        dims = ("point", *(f"{name}_{k}" for k in range(len(output.shape))))
        zarr.create_array(
            target,
            name=name,
            shape=(store.points, *output.shape),
            chunks=(store.shard, *output.shape),
            dtype=np.dtype(output.dtype),
            compressors=None,
            fill_value=output.fill,
            dimension_names=dims,
            attributes={**_status_attributes(name), **about.get(name, {})},
            overwrite=True,
            zarr_format=3,
        )
    with (
        warnings.catch_warnings()
    ):  # that consolidated metadata are not part of the format 3 yet; all readers know them
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(target)
    group = store.folder / "zarr.json"  # whose arrays are in the order of the file system
    group.write_text(json.dumps(json.loads(group.read_bytes()), indent=1, sort_keys=True))


def attributes_of(names: Sequence[str], units: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the attributes of arrays, by name, for those with a unit."""
    return {name: variable_attributes(units[name], name.replace("_", " ")) for name in names if name in units}


def _status_attributes(name: str) -> dict[str, Any]:
    if name != STATUS:
        return {}
    return {
        "long_name": "status of the point",
        "flag_values": list(range(len(STATUSES))),
        "flag_meanings": " ".join(STATUSES),
    }
