"""Distribute paths × instants over devices."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

MIN_INSTANTS = 65536
"""With fewer instants, counted over all paths, one device is used."""

AXIS = "batch"


class Spread(NamedTuple):
    """A mesh with one axis, and whether it divides the paths or the instants."""

    mesh: Mesh
    over: str

    @property
    def paths(self) -> PartitionSpec:
        """The partition of arrays whose first axis is the paths."""
        return PartitionSpec(AXIS) if self.over == "paths" else PartitionSpec()

    @property
    def lead(self) -> tuple[str | None, str | None]:
        """The mesh axes of (paths, instants)."""
        return (AXIS, None) if self.over == "paths" else (None, AXIS)

    def columns(self, rows: int) -> PartitionSpec:
        """The partition of arrays (rows, instants) with one row, or one for each path."""
        if self.over == "instants":
            return PartitionSpec(None, AXIS)
        return PartitionSpec() if rows == 1 else PartitionSpec(AXIS)

    def sharding(self, spec: PartitionSpec) -> NamedSharding:
        """The sharding over the mesh for this partition."""
        return NamedSharding(self.mesh, spec)


def spread(count: int, instants: int, devices: Sequence[Any] | None) -> Spread | None:
    """Divide the paths if their number is a multiple of the number of devices, else the instants; None for one device.

    By default all local devices are used if there are at least `MIN_INSTANTS` instants.
    """
    if devices is None:
        devices = jax.local_devices() if count * instants >= MIN_INSTANTS else ()
    for number in range(len(devices), 1, -1):
        for over, size in (("paths", count), ("instants", instants)):
            if size % number == 0:
                return Spread(Mesh(np.asarray(devices[:number]), (AXIS,)), over)
    return None
