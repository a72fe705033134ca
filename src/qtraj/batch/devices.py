"""Divide the paths or the instants of an evaluation among devices."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

MIN_INSTANTS = 65536
"""Minimum number of instants, counted over all paths, for which several devices are used by default."""

AXIS = "batch"


class Spread(NamedTuple):
    """A device mesh with one axis, and the dimension that is divided among the devices, "paths" or "instants"."""

    mesh: Mesh
    over: str

    @property
    def paths(self) -> PartitionSpec:
        """The partition of arrays whose first axis is the path."""
        return PartitionSpec(AXIS) if self.over == "paths" else PartitionSpec()

    @property
    def lead(self) -> tuple[str | None, str | None]:
        """The mesh axis that divides the paths, or None, and the mesh axis that divides the instants, or None."""
        return (AXIS, None) if self.over == "paths" else (None, AXIS)

    def columns(self, rows: int) -> PartitionSpec:
        """Return the partition of arrays (rows, instants) with one row for all paths, or one row for each path."""
        if self.over == "instants":
            return PartitionSpec(None, AXIS)
        return PartitionSpec() if rows == 1 else PartitionSpec(AXIS)

    def sharding(self, spec: PartitionSpec) -> NamedSharding:
        """Return the sharding over the mesh for the partition `spec`."""
        return NamedSharding(self.mesh, spec)


def spread(count: int, instants: int, devices: Sequence[Any] | None) -> Spread | None:
    """Divide the paths or the instants equally among as many devices as possible.

    If both can be divided equally, the paths are divided. By default the local devices are used if there are at least
    `MIN_INSTANTS` instants, counted over all paths. If only one device would be used, return None.
    """
    if devices is None:
        devices = jax.local_devices() if count * instants >= MIN_INSTANTS else ()
    for number in range(len(devices), 1, -1):
        for over, size in (("paths", count), ("instants", instants)):
            if size % number == 0:
                return Spread(Mesh(np.asarray(devices[:number]), (AXIS,)), over)
    return None
