"""Create labelled datasets of paths with xarray, and write them as netCDF files with h5netcdf.

Paths of different durations share the dimension `path`. Their samples share the dimension `sample`, whose coordinate
`progress` is time divided by duration, from 0 to 1. The time of each sample is the two-dimensional coordinate
`time(path, sample)`. `dataset.sel(path="after")` selects one path, and differences between paths are computed at equal
progress.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray

from qtraj.batch.evaluate import evaluate
from qtraj.batch.table import Table
from qtraj.design.along import Along
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import Ellipse
from qtraj.design.fitting.facts import fit_variables
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate
from qtraj.design.regions import Regions
from qtraj.foundation.arrays import as_float
from qtraj.foundation.provenance import provenance_attributes
from qtraj.foundation.record import LABELS, variable_attributes
from qtraj.io.findings import finding_variables
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.channel import CHANNELS, outputs_with
from qtraj.path.distances import distances
from qtraj.path.driving import default_frame
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.own_name import OwnName
from qtraj.path.quantity import COMBINED, QUANTITIES, SIDES, quantity
from qtraj.path.route import Route
from qtraj.path.track import Track, elapsed_times, to_float64
from qtraj.path.trihedral import AbstractFrame, Upright
from qtraj.path.vehicle import Vehicle
from qtraj.path.vehicle_data import vehicle_quantities

SAMPLES = 513
"""Default number of samples of each path."""

LIMIT_VARIABLES = {name: entry.variable for name, entry in (QUANTITIES | SIDES).items()}
"""The variable that each limit bounds, by the name of the limit."""

SIGNED_VARIABLES = frozenset(entry.variable for entry in (QUANTITIES | SIDES).values() if entry.signed)
"""The variables with signed values; a limit on any other variable bounds its magnitude."""

AT_SPEED = " at this speed"
"""The end of the meaning of a limit that depends on the speed."""

LAYOUT = "time(path, sample) is the time from the start of the path; progress(sample) = time / duration, from 0 to 1"


def conventions(frame: str) -> dict[str, str]:
    """Return the attributes of a dataset of attitudes along a path, for the frame named `frame`."""
    about = framed(frame)
    return about | {
        "quaternion_convention": f"{about['quaternion_convention']}, sign continuous in time",
        "frame_convention": f"{frame} frame, {about['frame_convention']}",
        "rate_convention": "rate and angular_acceleration of the frame, in body axes",
    }


def path_dataset(
    paths: Mapping[str, AbstractHodograph],
    limits: Limits | None = None,
    track: Track | None = None,
    samples: int = SAMPLES,
    attributes: Mapping[str, str] | None = None,
    fitted: Fitted | None = None,
    frame: Frame | None = None,
    findings: Mapping[str, Certificate] | None = None,
) -> xarray.Dataset:
    """Combine paths, given by name, into one dataset with units, meanings and conventions (extra `io`).

    The dataset contains all outputs of `qtraj.evaluate` at `samples` instants of each path. Attitudes and rates refer
    to `frame`. For a route, the default is `Driving` if the route stops or reverses, otherwise `Upright()`. For other
    paths, the default is `Upright()` if there is a recorded `track`, because vehicles stay upright, otherwise
    `Natural()`. A limited variable has the attributes `limit` and `lower_limit`, as far as they exist. The positions of
    a recorded track are added as `recorded_position`, and the times from its first sample as `recorded_time`. The
    properties of a `fitted` path become variables and attributes whose names begin with `fit_`. `findings` contains
    certificates of paths, by the names of the paths. The certificates become the variables `largest_curvature`,
    `largest_curvature_time` and `finding_curvature` for a limit on curvature, and similarly for other limits; those of
    a lower bound on the speed are `smallest_speed`, `smallest_speed_time` and `finding_smallest_speed`. These variables
    refer to the whole path, not only to its samples. If the limits have a vehicle, the dataset also contains forces and
    power; the parameters of the vehicle are variables whose names begin with `vehicle_`.

    **Raises:** ValueError if there is no path, or fewer than 2 samples are requested.
    """
    if not paths or samples < 2:
        raise ValueError(
            "expected at least one path and at least 2 samples, but "
            f"{len(paths)} paths and {samples} samples were given"
        )
    progress = np.linspace(0.0, 1.0, samples)
    vehicle = None if limits is None else limits.vehicle
    frames = [_frame(path, track) if frame is None else frame for path in paths.values()]
    others = {} if limits is None else {name_of_output(name): None for name in limits.given()}
    own = [name for name in others if name is not None]
    tables = [_table(path, progress, frame, vehicle, own) for path, frame in zip(paths.values(), frames, strict=True)]
    columns = [_columns(path, table) for path, table in zip(paths.values(), tables, strict=True)]
    name_of_frame = tables[0].frame
    variables: dict[str, Any] = {}
    for name, (dims, _, about) in columns[0].items():
        stacked = np.stack([column[name][1] for column in columns])
        variables[name] = (("path", *dims), stacked, about)
    given: dict[str, Any] = {} if limits is None else limits.given()  # pyright: ignore[reportAssignmentType]
    for name, limit in given.items():
        if isinstance(limit, Ellipse):
            variables[name] = _used(variables, limit)
            continue
        variable, attribute = quantity(name).variable, limit_attribute(name)
        if isinstance(limit, BySpeed):
            values = np.asarray(limit.at(variables["speed"][1]), float)
            about = variable_attributes(quantity(name).unit, f"limit on the {quantity(name).meaning}{AT_SPEED}")
            variables[f"{variable}_{attribute}"] = (("path", "sample"), values, about)
        elif isinstance(limit, Along | Regions):
            variables[f"{variable}_{attribute}"] = _along(paths, progress, name, limit)
        else:
            variables[variable][2][attribute] = float(limit)
    variables |= finding_variables(list(paths), findings or {})
    for name, fact in vehicle_quantities(vehicle).items():
        variables[name] = (fact.axes, np.asarray(fact.values), variable_attributes(fact.unit, fact.meaning))
    coordinates: dict[str, Any] = {
        "path": ("path", list(paths), {"long_name": "path"}),
        "progress": ("sample", progress, {"units": "1", "long_name": "time divided by duration"}),
        "time": variables.pop("time"),
        **{axis: (axis, labels) for axis, labels in labels_of(name_of_frame).items()},
        **({} if vehicle is None else {"friction_axis": LABELS["friction_axis"]}),
    }
    if track is not None:
        coordinates["recorded_time"] = (
            "record",
            elapsed_times(track),
            variable_attributes("s", "time from the first recorded sample"),
        )
        dims = ("record", "world")
        variables["recorded_position"] = (
            dims,
            to_float64(track.positions),
            variable_attributes("m", "recorded position, world axes"),
        )
    about = {} if fitted is None else with_fit(variables, fitted)
    made = provenance_attributes(np.asarray(next(iter(paths.values())).duration).dtype)
    whole = {**conventions(name_of_frame), "layout": LAYOUT, **made, **about, **(attributes or {})}
    return xarray.Dataset(variables, coordinates, whole)


def _used(variables: Mapping[str, Any], limit: Ellipse) -> tuple[Any, ...]:
    """Return the variable of the combined acceleration relative to an ellipse, whose limit is 1."""
    names = ("longitudinal_acceleration", "lateral_acceleration", "speed")
    values = np.asarray(limit.usage(*(variables[name][1] for name in names)), float)
    return ("path", "sample"), values, variable_attributes("1", quantity(COMBINED).meaning) | {"limit": 1.0}


def _along(paths: Mapping[str, Any], progress: np.ndarray, name: str, limit: Along | Regions) -> tuple[Any, ...]:
    """Return the variable of a limit that changes along the way."""
    rows = []
    for path in paths.values():
        s = distances(path).at(progress * float(path.duration))
        own = limit.along(path, quantity(name).side) if isinstance(limit, Regions) else limit
        rows.append(np.asarray(own.at(s), float))
    about = f"limit on the {quantity(name).meaning}; infinite where there is none"
    return ("path", "sample"), np.stack(rows), variable_attributes(quantity(name).unit, about)


def limit_attribute(name: str) -> str:
    """Return the name of the attribute of a variable that contains this limit.

    A limit that changes along the way is in a variable of its own, whose name ends with this name.
    """
    return "lower_limit" if quantity(name).lower else "limit"


def limited_variables(dataset: xarray.Dataset) -> list[str]:
    """Return the variables with a limit."""
    known = dict.fromkeys(name for name in LIMIT_VARIABLES.values() if name in dataset)
    known |= dict.fromkeys(own_variables(dataset))
    return [name for name in known if limits_of(dataset[name]) or limits_along(dataset, name)]


def own_variables(dataset: xarray.Dataset) -> list[str]:
    """Return the limited variables that are not in the registry: quantities of one's own."""
    known = {*LIMIT_VARIABLES.values(), *(f"{name}_{x}" for name in dataset for x in ("limit", "lower_limit"))}
    along = dataset["time"].dims[-1:]
    return [
        str(name)
        for name, x in dataset.items()
        if name not in known and x.dims[-1:] == along and (limits_of(x) or limits_along(dataset, str(name)))
    ]


def limits_of(variable: xarray.DataArray) -> list[float]:
    """Return the lower and the upper limit of a variable, as far as they exist."""
    return [float(variable.attrs[name]) for name in ("lower_limit", "limit") if name in variable.attrs]


def limits_along(dataset: xarray.Dataset, name: str) -> list[str]:
    """Return the names of the variables with limits on a variable that change along the way."""
    return [own for x in ("lower_limit", "limit") if (own := f"{name}_{x}") in dataset]


def bounded_values(name: str, values: Any) -> np.ndarray:
    """Return the values that the limit of a variable bounds: signed values for `SIGNED_VARIABLES`, else magnitudes.

    Variables that are not in the registry, those of quantities of one's own, contain these values.
    """
    own = name in SIGNED_VARIABLES or name not in LIMIT_VARIABLES.values()
    return np.asarray(values, float) if own else np.abs(np.asarray(values, float))


def table_dataset(table: Table, fitted: Fitted | None, attributes: Mapping[str, str]) -> xarray.Dataset:
    """Return the dataset of a table of one path, with the conventions of its frame and the properties of its fit."""
    variables: dict[str, Any] = {}
    about = {} if fitted is None else with_fit(variables, fitted)
    dataset = table.to_xarray().assign(variables)
    return dataset.assign_attrs(conventions(table.frame) | dict(attributes) | about)


def with_fit(variables: dict[str, Any], fitted: Fitted) -> dict[str, str]:
    """Add the results of a fit to the `variables` of a dataset, and return further attributes for the dataset."""
    facts, attributes = fit_variables(fitted)
    for name, fact in facts.items():
        variables[name] = (fact.axes, fact.values, variable_attributes(fact.unit, fact.meaning))
    return attributes


def _frame(path: AbstractHodograph, track: Track | None) -> AbstractFrame:
    """Return the default frame of a path; with a recorded track, return `Upright()` for all paths except routes."""
    return default_frame(path) if track is None or isinstance(path, Route) else Upright()


def name_of_output(name: str) -> str | None:
    """Return the output with the limited values of a quantity of one's own, or None for a quantity of the registry."""
    return OwnName(quantity(name).variable, name.quantity) if isinstance(name, OwnName) else None


def _table(
    path: AbstractHodograph, progress: np.ndarray, frame: Frame, vehicle: Vehicle | None, own: Sequence[str]
) -> Table:
    """Evaluate all outputs of one path, its limited quantities of one's `own`, and forces if there is a vehicle."""
    duration = np.asarray(path.duration)
    times = as_float(duration * progress.astype(duration.dtype))
    return evaluate(path, times, (*outputs_with(vehicle), *own), frame, continuous=True, vehicle=vehicle)


def _columns(path: AbstractHodograph, table: Table) -> dict[str, tuple[tuple[str, ...], np.ndarray, Any]]:
    """Return every variable of one path as (dimensions, values, attributes)."""
    columns: dict[str, Any] = {
        "time": (("sample",), np.asarray(table.time), variable_attributes("s", "time from the start of the path")),
        "duration": ((), np.asarray(path.duration), variable_attributes("s", "duration of the path")),
    }
    for name, values in table.values.items():
        entry = CHANNELS[name]
        columns[name] = (
            ("sample", *entry.axes),
            np.asarray(values),
            variable_attributes(entry.unit, entry.meaning),
        )
    return columns
