"""Divide the paths or the instants of an evaluation among devices."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec, Sharding, SingleDeviceSharding

from qtraj.foundation.devices import chosen_device, device_of

MIN_INSTANTS = 65536
"""Minimum number of instants, counted over all paths, for which several devices are used by default."""

AXIS = "batch"


class Place(NamedTuple):
    """A device mesh with one axis, and the dimension that is divided among its devices, "paths" or "instants".

    With one device, nothing is divided, and `over` is None.
    """

    mesh: Mesh
    over: str | None

    @property
    def platform(self) -> str:
        """The platform of the devices, such as "cpu"."""
        return self.mesh.devices.flat[0].platform

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

    def sharding(self, spec: PartitionSpec | None = None) -> Sharding:
        """Return the sharding for the partition `spec`, or for arrays of which each device has a copy."""
        if self.over is None:
            return SingleDeviceSharding(self.mesh.devices.flat[0])
        return NamedSharding(self.mesh, PartitionSpec() if spec is None else spec)


ADVICE = ", or select devices with the argument devices"
"""What else helps if the arguments of an evaluation are on different devices."""


def as_devices(devices: Any) -> list[Any] | None:
    """Return `devices` as a list, or None without any.

    **Raises:** ValueError unless they are JAX devices.
    """
    if devices is None:
        return None
    found = list(devices) if isinstance(devices, Iterable) else []
    if not (found and all(isinstance(x, jax.Device) for x in found)):
        raise ValueError(f"devices must be a list such as jax.local_devices()[:1], but {devices!r} was given")
    return found


def placed(count: int, instants: int, devices: Sequence[Any] | None, arrays: Any) -> Place:
    """Return the place of an evaluation of `count` paths, and divide its work equally among many devices.

    If both paths and instants can be divided equally, the paths are divided. `devices` are given by the user. By
    default, an evaluation is where its `arrays` are. If they may be on any device, it is on the device that the user
    set as JAX's default. Without one, it is on all local devices if there are at least `MIN_INSTANTS` instants, counted
    over all paths, and otherwise on the first of them.

    **Raises:** ValueError if `arrays` are on different devices.
    """
    if devices is None:
        own = device_of(jax.tree.leaves(arrays), ADVICE) or chosen_device()
        many = own is None and count * instants >= MIN_INSTANTS
        devices = jax.local_devices() if many else [own or jax.local_devices()[0]]
    for number in range(len(devices), 1, -1):
        for over, size in (("paths", count), ("instants", instants)):
            if size % number == 0:
                return Place(Mesh(np.asarray(devices[:number]), (AXIS,)), over)
    return Place(Mesh(np.asarray(devices[:1]), (AXIS,)), None)
