"""Find the device of the arguments of a call, where its results belong."""

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax
from jax.core import Tracer

Function = TypeVar("Function", bound=Callable[..., Any])


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


def on_one_device(function: Function) -> Function:
    """Explain the failure of a function whose arguments are on different devices, as `device_of` does.

    JAX refuses such arguments, too, but names operations inside the function. Calls that succeed cost nothing.
    """

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except ValueError:
            device_of(jax.tree.leaves((args, kwargs)))
            raise

    return call  # type: ignore[return-value]


def of_one_device(function: Function) -> Function:
    """Refuse arguments on different devices, as `device_of` does, and return the result on the device of the arguments.

    This is for functions that compute on the host, which would copy arrays from any devices. JAX arrays of the result
    are moved; NumPy arrays stay NumPy arrays.
    """

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        device = device_of(jax.tree.leaves((args, kwargs)))
        result = function(*args, **kwargs)
        return result if device is None else _moved(result, device)

    return call  # type: ignore[return-value]


def _moved(tree: Any, device: Any) -> Any:
    leaves, structure = jax.tree.flatten(tree)
    places = [k for k, x in enumerate(leaves) if isinstance(x, jax.Array) and not isinstance(x, Tracer)]
    for k, x in zip(places, jax.device_put([leaves[k] for k in places], device), strict=True):
        leaves[k] = x
    return structure.unflatten(leaves)


def chosen_device() -> Any:
    """Return the device that the user set as JAX's default, or None."""
    chosen = jax.config.jax_default_device  # type: ignore[attr-defined]
    return jax.local_devices(backend=chosen)[0] if isinstance(chosen, str) else chosen


def default_platform() -> str:
    """Return the platform of JAX's default device, such as "cpu"."""
    chosen = chosen_device()
    return jax.default_backend() if chosen is None else chosen.platform
