"""Read every object of a netCDF file, and write what is wrong to stdout; exhausted memory is reported to stderr.

`netcdf` runs this module in a child process: python -m qtraj.io.netcdf_probe FILE.
"""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.io.damaged import fault

MAX_BYTES = 2**30
"""Maximum total size of the variables of a small file; a valid file may be sparse, so it may be much smaller."""

MAX_COMPRESSION = 1032
"""The largest possible ratio of sizes before and after compression by DEFLATE."""


def probe(file: Path) -> None:
    """Read all variables and attributes, and raise an error if one of them cannot be read."""
    import h5netcdf

    largest = max(MAX_BYTES, MAX_COMPRESSION * os.path.getsize(file))
    total = 0
    with h5netcdf.File(file, "r") as content:
        for group in _groups(content):
            dict(group.attrs)
            for name, variable in group.variables.items():
                size = variable.dtype.itemsize
                for length in variable.shape:
                    size *= length
                total += size
                if total > largest:
                    raise ValueError(
                        f"variable {name} has {size:.3g} bytes, but all variables of a file of this size may have "
                        f"{largest:.3g} bytes together"
                    )
                dict(variable.attrs)
                tuple(variable.dimensions)
                np.asarray(variable[...])


def _groups(group: Any) -> Iterator[Any]:
    yield group
    for inner in group.groups.values():
        yield from _groups(inner)


if __name__ == "__main__":
    try:
        probe(Path(sys.argv[1]))
    except Exception as error:
        stream = sys.stderr if isinstance(error, MemoryError) else sys.stdout
        stream.write(fault(error))
        stream.flush()
        os._exit(1)  # HDF5 may crash when it closes a damaged file
