"""How paths × instants are spread over devices."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

LEAST = 65536
"""Instants, over all paths, below which one device is enough."""

AXIS = "batch"


class Spread(NamedTuple):
    """A mesh of one axis, and which of (paths, instants) it divides."""

    mesh: Mesh
    over: str

    @property
    def paths(self) -> PartitionSpec:
        """For arrays with a leading axis of paths."""
        return PartitionSpec(AXIS) if self.over == "paths" else PartitionSpec()

    @property
    def lead(self) -> tuple[str | None, str | None]:
        """How (paths, instants) are divided."""
        return (AXIS, None) if self.over == "paths" else (None, AXIS)

    def columns(self, rows: int) -> PartitionSpec:
        """For arrays (rows, instants), one row or one for each path."""
        if self.over == "instants":
            return PartitionSpec(None, AXIS)
        return PartitionSpec() if rows == 1 else PartitionSpec(AXIS)

    def sharding(self, spec: PartitionSpec) -> NamedSharding:
        return NamedSharding(self.mesh, spec)


def spread(count: int, instants: int, devices: Sequence[Any] | None) -> Spread | None:
    """Over the paths where their number can be divided evenly, else over the instants; None for one device.

    `devices` None means all local ones, if there is enough to do.
    """
    if devices is None:
        devices = jax.local_devices() if count * instants >= LEAST else ()
    for number in range(len(devices), 1, -1):
        for over, size in (("paths", count), ("instants", instants)):
            if size % number == 0:
                return Spread(Mesh(np.asarray(devices[:number]), (AXIS,)), over)
    return None
