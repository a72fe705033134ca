"""Convert plain arrays over time to labelled datasets."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from qtraj.foundation.arrays import as_float, as_seconds
from qtraj.foundation.record import Quantity, Record, require_concrete, to_dataset
from qtraj.foundation.types import ArrayInput

if TYPE_CHECKING:
    import xarray

PREDEFINED = {
    "quaternion": ("1", "attitude, scalar first, body to inertial", (4,)),
    "error": ("1", "error quaternion of a feedback law", (4,)),
    "rate": ("rad s-1", "angular rate, body axes", (3, 4)),
    "acceleration": ("rad s-2", "angular acceleration, body axes", (3, 4)),
    "command": ("rad s-2", "commanded angular acceleration, body axes", (4,)),
    "angle": ("rad", "angle", (0,)),
    "torque": ("N m", "torque, body axes", (3,)),
    "force": ("N", "force, body axes", (3,)),
}
"""Unit, meaning and possible numbers of components of arrays with a predefined name; 0 means no component axis."""

COMPONENTS = {3: "body", 4: "component"}
"""Name of the component axis, by the number of components."""

ANY = (0, *COMPONENTS)
"""Possible numbers of components of any other array; 0 means one number at each instant."""

TAKEN = ("time", *COMPONENTS.values())
"""Names of the coordinates of the dataset, which no array may have."""


def label(
    times: ArrayInput, attributes: Mapping[str, Any] | None = None, **arrays: ArrayInput | tuple[ArrayInput, str, str]
) -> xarray.Dataset:
    """Combine arrays over `times` (n,) [s] into an `xarray.Dataset` with units and conventions (extra `io`).

    Use this function for the plain arrays of `propagate`, `propagate_samples`, `error_response` and `jax.vmap`, for
    example `label(times, quaternion=qs)`. The following names have predefined units: quaternion, error and command
    (*batch, n, 4); rate and acceleration (*batch, n, 3), or (*batch, n, 4) with the virtual scalar part first; torque
    and force (*batch, n, 3); angle (*batch, n). Pass any other array, with 3, 4 or no components, as (array, unit,
    meaning), with the unit in netCDF notation ("m s-2"); three components are in body axes. Provenance and `attributes`
    become attributes of the dataset.

    **Raises:** ValueError for arrays of other shapes, an unknown name, the name of a coordinate, or times that are NaN;
    also if no array is passed, or inside a trace. ModuleNotFoundError with the extra to install, if xarray is missing.
    """
    require_concrete((times, arrays))
    instants = as_seconds(times)
    if instants.ndim != 1 or not arrays:
        raise ValueError(
            f"expected times (n,) and at least one array with a value for each time, but times of shape "
            f"{instants.shape} and {len(arrays)} arrays were given"
        )
    if np.isnan(instants).any():
        raise ValueError("times must be numbers, but some of them are NaN")
    variables = {name: _quantity(name, array, instants.shape[0]) for name, array in arrays.items()}
    time = Quantity(instants, "s", "time", ("time",))
    return to_dataset(Record(", ".join(variables), variables, {"time": time}, {"frame": "body"}), attributes)


def _quantity(name: str, entry: Any, count: int) -> Quantity:
    if name in TAKEN:
        raise ValueError(f"{name!r} is the name of a coordinate of the dataset: choose another name for the array")
    described = isinstance(entry, tuple) and len(entry) == 3 and all(isinstance(text, str) for text in entry[1:])
    if not described and name not in PREDEFINED:
        raise ValueError(
            f"{name!r} has no predefined unit: pass it as (array, unit, meaning). The names with predefined units are "
            f"{', '.join(PREDEFINED)}."
        )
    array, unit, meaning = entry if described else (entry, *PREDEFINED[name][:2])
    sizes = ANY if described else PREDEFINED[name][2]
    values = np.asarray(as_float(array))
    # Check for a component axis first: with 3 or 4 instants, the components could be mistaken for instants, and the
    # instants for a batch.
    if values.shape[-2:-1] == (count,) and values.shape[-1] in sizes and values.shape[-1] in COMPONENTS:
        return Quantity(values, unit, meaning, ("time", COMPONENTS[values.shape[-1]]))
    if values.shape[-1:] == (count,) and 0 in sizes:
        return Quantity(values, unit, meaning, ("time",))
    forms = [f"(*batch, {count}, {size})" if size else f"(*batch, {count})" for size in sizes]
    raise ValueError(f"{name} must have the shape {' or '.join(forms)}, but shape {values.shape} was given")
