"""From anything that a user wants drawn to the dataset that figures and reports draw."""

from typing import Any

import jax.numpy as jnp
import xarray

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.limits import Limits
from qtraj.design.tuning.outcome import Tuned
from qtraj.foundation.result import AbstractResult
from qtraj.io.dataset import path_dataset
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.placement import Placement
from qtraj.path.quantity import QUANTITIES
from qtraj.path.spiral_helix import SpiralHelix

COEFFICIENTS = ("radius", "angle", "height", "duration")
"""What a dataset holds that is a spiral-helix itself, not its samples."""


def drawable(given: Any, frame: Frame | None = None) -> xarray.Dataset:
    """Samples of a path, a tuned or a fitted one, or the dataset of any other result; a dataset of samples as it is.

    The dataset of a path itself, which holds its coefficients (`tuned.to_xarray()`, `helix.to_xarray()`), becomes that
    of its samples. `frame` is that of the trihedra where samples are made here: the natural one without it.

    **Raises:** ValueError for many paths, and for what is none of these.
    """
    if isinstance(given, xarray.Dataset):
        whole = all(name in given for name in COEFFICIENTS) and "time" not in given.variables
        return _sampled(given, frame) if whole else given
    if isinstance(given, Tuned):
        path, limits = _one(given.path), limits_of(given)
        notes = {"tuning_result": given.result}
        return path_dataset(
            {"after": path}, limits, attributes=notes, frame=frame, findings={"after": given.certificate}
        )
    if isinstance(given, Fitted):
        return path_dataset({"fitted": _one(given.path)}, frame=frame, fitted=given)
    if isinstance(given, AbstractHodograph):
        return path_dataset({"path": _one(given)}, frame=frame)
    if isinstance(given, AbstractResult):
        return given.to_xarray()
    raise ValueError(
        "a path, a result or a dataset of samples, such as that of qtraj.io.dataset.path_dataset, was expected, but a "
        f"{type(given).__name__} was given"
    )


def of_paths(given: Any) -> xarray.Dataset:
    """Samples over the dimensions `path` and `sample`, as `qtraj.io.dataset.path_dataset` makes them.

    **Raises:** ValueError for a dataset without them, naming what is missing.
    """
    dataset = drawable(given)
    missing = [name for name in ("path", "sample") if name not in dataset.dims]
    missing += [name for name in ("time", "position", "dcm", "defined") if name not in dataset.variables]
    if missing:
        raise ValueError(
            f"a figure of paths needs {', '.join(missing)}, which this dataset has not: pass the path itself, or "
            "qtraj.io.dataset.path_dataset({name: path}); a table draws itself with plot()"
        )
    return dataset


def limits_of(tuned: Tuned) -> Limits:
    """The limits that a tuning was given, as its certificate knows them; a corridor is none of a path alone."""
    return Limits(**{name: limit for name, (_, _, limit) in tuned.certificate.worst.items() if name in QUANTITIES})


def _one(path: AbstractHodograph) -> Any:
    if jnp.ndim(path.duration):
        raise ValueError(
            f"one path was expected, but {path.duration.shape[0]} stacked ones were given: take one of them, "
            "outcome[k] or jax.tree.map(lambda x: x[k], paths), or the table of qtraj.evaluate"
        )
    return path


def _sampled(dataset: xarray.Dataset, frame: Frame | None) -> xarray.Dataset:
    """The samples of the path whose coefficients a dataset holds, with the limits that stand beside them."""
    placement = None
    if "origin" in dataset:
        placement = Placement(dataset["origin"].values, dataset["orientation"].values)
    if dataset["duration"].ndim:
        count = dataset["duration"].size
        raise ValueError(f"one path was expected, but the dataset holds {count}: select one of them first")
    radius, angle, height, duration = (dataset[name].values for name in COEFFICIENTS)
    path = SpiralHelix(radius, angle, height, duration, placement)
    limits = None
    if "bound" in dataset and dataset["bound"].dims == ("limit",):
        names = dataset["limit"].values.tolist()
        pairs = zip(names, dataset["bound"].values.tolist(), strict=True)
        limits = Limits(**{name: bound for name, bound in pairs if name in QUANTITIES})
    kept = {name: text for name, text in dataset.attrs.items() if name in ("title", "scenario_file", "recording")}
    return path_dataset({"path": path}, limits, attributes=kept, frame=frame)
