"""Plain arrays over time as labelled data."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from qtraj.foundation.arrays import as_float
from qtraj.foundation.record import Quantity, Record, require_known, to_dataset
from qtraj.foundation.types import ArrayInput

if TYPE_CHECKING:
    import xarray

KNOWN = {
    "quaternion": ("1", "attitude, scalar first, body to inertial"),
    "error": ("1", "error quaternion of a feedback law"),
    "rate": ("rad s-1", "angular rate, body axes"),
    "acceleration": ("rad s-2", "angular acceleration, body axes"),
    "command": ("rad s-2", "angular acceleration commanded, body axes"),
    "angle": ("rad", "angle"),
    "torque": ("N m", "torque, body axes"),
    "force": ("N", "force, body axes"),
}
"""Units and meanings of the arrays that the functions on attitudes give."""

COMPONENTS = {3: "body", 4: "component"}
"""The axis of as many components."""


def label(
    times: ArrayInput, attributes: Mapping[str, Any] | None = None, **arrays: ArrayInput | tuple[ArrayInput, str, str]
) -> "xarray.Dataset":
    """Arrays over `times` (n,) [s] as an `xarray.Dataset` with units, conventions and provenance (extra `io`).

    For what `propagate`, `propagate_samples`, `error_response` and `jax.vmap` give as plain arrays:
    `label(times, quaternion=qs)`. Each array is (*lanes, n), or (*lanes, n, 3) or (*lanes, n, 4) with components on its
    last axis. Known by their names are quaternion, error, rate, acceleration, command, angle, torque and force; any
    other is given as (array, unit, meaning), its unit as netCDF writes it ("m s-2"), components then in body axes.
    `attributes` are added to the dataset's.

    **Raises:** ValueError for other shapes, a name that is not known, no array, or inside a trace;
    ModuleNotFoundError, naming the extra, where xarray is missing.
    """
    require_known((times, arrays))
    instants = as_float(times)
    if instants.ndim != 1 or not arrays:
        raise ValueError(
            f"times (n,) and at least one array over them were expected, but times of shape {instants.shape} and "
            f"{len(arrays)} arrays were given"
        )
    variables = {name: _quantity(name, given, instants.shape[0]) for name, given in arrays.items()}
    time = Quantity(instants, "s", "time", ("time",))
    return to_dataset(Record(", ".join(variables), variables, {"time": time}, {"frame": "body"}), attributes)


def _quantity(name: str, given: Any, count: int) -> Quantity:
    described = isinstance(given, tuple) and len(given) == 3 and all(isinstance(text, str) for text in given[1:])
    if not described and name not in KNOWN:
        raise ValueError(
            f"{name!r} is not known; known are {', '.join(KNOWN)}. Give any other as (array, unit, meaning)."
        )
    array, unit, meaning = given if described else (given, *KNOWN[name])
    values = np.asarray(as_float(array))
    if values.shape[-1:] == (count,) and not (values.shape[-2:-1] == (count,) and count in COMPONENTS):
        return Quantity(values, unit, meaning, ("time",))
    if values.shape[-2:-1] == (count,) and values.shape[-1] in COMPONENTS:
        return Quantity(values, unit, meaning, ("time", COMPONENTS[values.shape[-1]]))
    raise ValueError(
        f"{name} must be (*lanes, {count}), or with components (*lanes, {count}, 3) or (*lanes, {count}, 4), "
        f"but an array of shape {values.shape} was given"
    )
