"""Convert paths and results to the dataset that figures and reports draw."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import xarray

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.limits import Limits, limits_of as limits_from
from qtraj.design.timing.outcome import Retimed
from qtraj.design.tuning.outcome import Tuned
from qtraj.foundation.result import AbstractResult
from qtraj.io.dataset import path_dataset
from qtraj.io.retimed_dataset import retimed_dataset
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.channel import provided
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.own_name import OwnName
from qtraj.path.placement import Placement
from qtraj.path.quantity import QUANTITIES, SIDES
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.vehicle import Vehicle
from qtraj.path.vehicle_data import vehicle_from

COEFFICIENTS = ("radius", "angle", "height", "duration")
"""The variables of a dataset that contains the coefficients of a spiral-helix instead of samples."""


def drawable(source: Any, frame: Frame | None = None) -> xarray.Dataset:
    """Return the samples of a path, or of a tuned, retimed or fitted path, or the `to_xarray()` of any other result.

    A dataset of samples is returned unchanged. If a dataset contains the coefficients of a path (`tuned.to_xarray()`,
    `helix.to_xarray()`), the path is evaluated at samples. `frame` is the frame of the samples that are computed, or
    None for the default frame.

    **Raises:** ValueError for more than one path, or an object of any other type.
    """
    if isinstance(source, xarray.Dataset):
        whole = all(name in source for name in COEFFICIENTS) and "time" not in source.variables
        return _sampled(source, frame) if whole else source
    if isinstance(source, Tuned):
        path, limits = _one(source.path), limits_of(source)
        notes = {"tuning_result": source.result}
        return path_dataset(
            {"after": path}, limits, attributes=notes, frame=frame, findings={"after": source.certificate}
        )
    if isinstance(source, Retimed):
        _one(source.path)
        return retimed_dataset(source, frame=frame)
    if isinstance(source, Fitted):
        return path_dataset({"fitted": _one(source.path)}, frame=frame, fitted=source)
    if isinstance(source, AbstractHodograph):
        return path_dataset({"path": _one(source)}, frame=frame)
    if isinstance(source, AbstractResult):
        return source.to_xarray()
    raise ValueError(
        "a path, a result, or a dataset of samples as returned by qtraj.io.dataset.path_dataset was expected, but "
        f"{type(source).__name__} was given"
    )


def path_samples(source: Any) -> xarray.Dataset:
    """Return a dataset with the dimensions `path` and `sample`, like the results of `qtraj.io.dataset.path_dataset`.

    **Raises:** ValueError if the dataset of `source` does not contain samples of paths; the message names the missing
    dimensions and variables.
    """
    dataset = drawable(source)
    missing = [name for name in ("path", "sample") if name not in dataset.dims]
    missing += [name for name in ("time", "position", "dcm", "defined") if name not in dataset.variables]
    if missing:
        raise ValueError(
            f"a figure of paths needs {', '.join(missing)}, which this dataset does not contain: pass the path itself, "
            "or qtraj.io.dataset.path_dataset({name: path}); to draw a table, call its plot()"
        )
    return dataset


def limits_of(tuned: Tuned) -> Limits:
    """Return the limits of a tuning from its certificate, except a corridor, which depends on a second path."""
    return _path_limits({name: limit for name, (_, _, limit) in tuned.certificate.worst.items()}, tuned.vehicle)


def _path_limits(given: Mapping[str, Any], vehicle: Vehicle | None) -> Limits:
    """Select the limits on a single path that can be evaluated with this `vehicle`, or without one if it is None."""
    available = provided(vehicle)
    names = [name for name, entry in (QUANTITIES | SIDES).items() if entry.needs in available]
    bounds = {name: limit for name, limit in given.items() if name in names or isinstance(name, OwnName)}
    return limits_from(bounds, vehicle)


def _one(path: AbstractHodograph) -> Any:
    if jnp.ndim(path.duration):
        raise ValueError(
            f"one path was expected, but a batch of {path.duration.shape[0]} was given: select one path with result[k] "
            "or jax.tree.map(lambda x: x[k], paths), or draw the table of qtraj.evaluate"
        )
    return path


def _sampled(dataset: xarray.Dataset, frame: Frame | None) -> xarray.Dataset:
    """Return samples of a path, from a dataset with its coefficients; the limits of the dataset are kept."""
    placement = None
    if "origin" in dataset:
        placement = Placement(dataset["origin"].values, dataset["orientation"].values)
    if dataset["duration"].ndim:
        count = dataset["duration"].size
        raise ValueError(f"one path was expected, but the dataset contains {count}: select one of them first")
    radius, angle, height, duration = (dataset[name].values for name in COEFFICIENTS)
    path = SpiralHelix(radius, angle, height, duration, placement)
    limits = None
    if "bound" in dataset and dataset["bound"].dims == ("limit",):
        names = dataset["limit"].values.tolist()
        limits = _path_limits(dict(zip(names, dataset["bound"].values.tolist(), strict=True)), vehicle_from(dataset))
    kept = {name: text for name, text in dataset.attrs.items() if name in ("title", "scenario_file", "recording")}
    return path_dataset({"path": path}, limits, attributes=kept, frame=frame)
