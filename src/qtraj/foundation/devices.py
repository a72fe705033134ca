"""Find the device of the arguments of a call, where its results belong."""

from collections.abc import Iterable
from typing import Any

import jax
from jax.core import Tracer


def device_of(leaves: Iterable[Any], advice: str = "") -> Any:
    """Return the device to which arrays were moved, as by `jax.device_put`, or None if they may be on any device.

    NumPy arrays, tracers, results on JAX's default device and arrays that are distributed over several devices may be
    on any. `advice` is added to the message of the error.

    **Raises:** ValueError if arrays were moved to different devices.
    """
    found, distributed = set(), False
    for x in leaves:
        if isinstance(x, jax.Array) and not isinstance(x, Tracer) and x.committed:
            devices = x.devices()
            distributed = distributed or len(devices) > 1
            found |= devices
    if distributed:
        return None
    if len(found) > 1:
        names = " and ".join(sorted(f"{x.platform}:{x.id}" for x in found))
        raise ValueError(
            f"the arguments are on different devices, {names}: move them to one device with jax.device_put(x, device)"
            + advice
        )
    return next(iter(found), None)


def chosen_device() -> Any:
    """Return the device that the user set as JAX's default, or None."""
    chosen = jax.config.jax_default_device  # type: ignore[attr-defined]
    return jax.local_devices(backend=chosen)[0] if isinstance(chosen, str) else chosen


def default_platform() -> str:
    """Return the platform of JAX's default device, such as "cpu"."""
    chosen = chosen_device()
    return jax.default_backend() if chosen is None else chosen.platform
