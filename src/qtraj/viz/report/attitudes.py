"""Create the report on attitudes over time: a slew, a closed loop, or any dataset with a quaternion over `time`."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray

from qtraj.viz.report.frames import cosines
from qtraj.viz.report.model import Arrow, Body, Panel, Report, Series, Table, number, sentence, unit, words
from qtraj.viz.report.provenance import provenance_table
from qtraj.viz.report.ranges import without_near_one
from qtraj.viz.style import COMPONENTS, SUBSCRIPTS, title

DASHES = {"w": "dash", "x": "solid", "y": "dashdot", "z": "dot"}
PLAIN = "#0072B2"
REFERENCE = "#777777"
MIN_ANGLE = 1e-7  # [°]; smaller angles are round-off, which a logarithmic axis would magnify

BESIDE = {
    "angle": ("closed_form_angle", "closed form"),
    "error": ("closed_form_error", "closed form"),
    "rate": ("program_rate", "program"),
    "quaternion": ("program_quaternion", "program"),
}
"""For each variable, the variable with which it is compared in its panel, and the label of the comparison."""

ORDER = (
    "angle",
    "angle_rate",
    "angle_acceleration",
    "error",
    "rate",
    "acceleration",
    "command",
    "virtual_command",
    "quaternion",
    "norm",
)
"""Order of the first panels; other variables over time follow."""

TITLES = {
    "error": "error quaternion",
    "rate": "rate, body axes",
    "acceleration": "angular acceleration, body axes",
    "torque": "torque, body axes",
    "command": "command, body axes",
    "norm": "norm of the quaternion",
    "momentum": "momenta of the wheels",
    "mismatch": "acceleration minus command, body axes",
}
APPLIES = "applies"
"""Value of the attribute `closed_form` if the closed form applies; otherwise the attribute contains the reason."""
LETTERS = {"quaternion": "λ", "error": "μ", "rate": "ω", "acceleration": "ε", "command": "u", "torque": "M"}
LETTERS |= {"momentum": "h", "mismatch": "Δε"}
WHEELS = ("#D55E00", "#009E73", "#0072B2", "#CC79A7", "#000000", "#E69F00")
"""Colours of the wheels, in order."""


def is_of_attitudes(dataset: xarray.Dataset) -> bool:
    """Return whether a dataset contains quaternions over `time`."""
    if not {"quaternion", "time"} <= set(map(str, dataset.variables)):
        return False
    return dataset["quaternion"].dims[:1] == ("time",) and dataset["quaternion"].shape[1:] == (4,)


def attitude_report(dataset: xarray.Dataset) -> Report:
    """Create the report on `quaternion` over `time`; `program_quaternion` is drawn pale for comparison."""
    time = dataset["time"].values
    bodies = [Body("body", time, None, cosines(dataset["quaternion"].values), PLAIN)]
    if "program_quaternion" in dataset:
        axes = cosines(dataset["program_quaternion"].values)
        bodies.append(Body("program", time, None, axes, REFERENCE, ghost=True))
    notes = dataset.attrs
    return Report(
        title=title(dataset) or "Attitude",
        kind="attitude",
        facts=_facts(notes),
        arrows=[Arrow(name, f"body axis {name}", COMPONENTS[name]) for name in "xyz"],
        bodies=bodies,
        panels=[_panel(dataset, name) for name in _shown(dataset)],
        tables=[_peaks(dataset), _ends(dataset), provenance_table(dataset)],
    )


def _facts(notes: Mapping[str, Any]) -> list[str]:
    """Return the result of the computation, and the reason if the closed form is not drawn."""
    reason = notes.get("closed_form", APPLIES)
    facts = [sentence(words(str(notes["result"])))] if "result" in notes else []
    return facts if reason == APPLIES else [*facts, f"The closed form is not drawn, because it {reason}."]


def _shown(dataset: xarray.Dataset) -> list[str]:
    """Return the names of the variables that have their own panel."""
    references = {name for name, _ in BESIDE.values()}
    names = [str(name) for name, variable in dataset.data_vars.items() if variable.dims[:1] == ("time",)]
    names = [name for name in names if name not in references and dataset[name].ndim <= 2]
    return sorted(names, key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER))


def _panel(dataset: xarray.Dataset, name: str) -> Panel:
    values, symbol = _in_degrees(dataset, name)
    error = name == "angle" and "error" in dataset
    labels = _labels(dataset, name)
    symbol_of = LETTERS.get(name, name.replace("_", " "))
    names = [f"{symbol_of}{_index(label)}" if dataset[name].ndim > 1 else label for label in labels]
    wheels = dataset[name].dims[-1] == "wheel"
    colours = [WHEELS[k % len(WHEELS)] if wheels else COMPONENTS.get(x, PLAIN) for k, x in enumerate(labels)]
    styles = [(colour, DASHES.get(label, "solid")) for colour, label in zip(colours, labels, strict=True)]
    lines = zip(names, values.T, styles, strict=True)
    series = [Series(text, 0, column, *style) for text, column, style in lines]
    span, note = without_near_one(values, names) if name in ("quaternion", "error") else (None, "")
    if name == "command" and not _of_each_axis(dataset):
        series.append(Series("norm", 0, np.linalg.norm(values, axis=1), "#333333", reference=True))
    if name in BESIDE and BESIDE[name][0] in dataset and _applies(dataset, BESIDE[name][0]):
        other, text = BESIDE[name]
        compared, _ = _in_degrees(dataset, other)
        series += [Series(text, 0, column, REFERENCE, "dot", reference=True) for column in compared.T]
    if error:
        series = [replace(line, values=np.where(line.values > MIN_ANGLE, line.values, np.nan)) for line in series]
    bounds = _limits(dataset, name)
    text = "limit " + ", ".join(f"{bound:.4g}" for bound in bounds)
    limits = [(sign * bound, text) for bound in bounds for sign in _signs(values)]
    heading = "error angle" if error else TITLES.get(name, name.replace("_", " "))
    return Panel(heading, symbol, series, limits, logarithmic=error, shown=span, note=note)


def _applies(dataset: xarray.Dataset, beside: str) -> bool:
    """Return whether the comparison with the variable `beside` applies; the closed form may not apply to the motion."""
    return not beside.startswith("closed_form") or dataset.attrs.get("closed_form", APPLIES) == APPLIES


def _of_each_axis(dataset: xarray.Dataset) -> bool:
    """Return whether the limit of the command applies to each component instead of the norm."""
    return dataset.attrs.get("saturation") == "axis"


def _signs(values: np.ndarray) -> tuple[float, ...]:
    """Return the signs of the lines of a limit: positive, and also negative if there are negative values."""
    low = np.nanmin(values, initial=0.0)
    return (1.0, -1.0) if low < -1e-9 * max(np.nanmax(values, initial=0.0), 1e-300) else (1.0,)


def _labels(dataset: xarray.Dataset, name: str) -> list[str]:
    variable = dataset[name]
    if variable.ndim == 1:
        return [name.replace("_", " ")]
    return [str(label) for label in variable[variable.dims[1]].values]


def _index(label: str) -> str:
    return SUBSCRIPTS.get(label, f" {label}")


def _in_degrees(dataset: xarray.Dataset, name: str) -> tuple[np.ndarray, str]:
    """Return the values (n, m) and their unit, with angles in degrees instead of radians."""
    values = dataset[name].values.astype(float)
    symbol = unit(dataset[name].attrs.get("units", ""))
    return _scale(dataset, name) * values.reshape(len(values), -1), symbol.replace("rad", "°")


def _limits(dataset: xarray.Dataset, name: str) -> list[float]:
    """Return the distinct limits of a variable, with angles in degrees instead of radians."""
    limits = np.ravel(dataset[name].attrs.get("limit", [])).astype(float)
    return np.unique(_scale(dataset, name) * limits).tolist()


def _scale(dataset: xarray.Dataset, name: str) -> float:
    return 180 / np.pi if dataset[name].attrs.get("units", "").startswith("rad") else 1.0


def _peaks(dataset: xarray.Dataset) -> Table:
    """Tabulate the largest norm or absolute value of each quantity, and its time; quaternions are omitted."""
    rows = []
    for name in _shown(dataset):
        values, symbol = _in_degrees(dataset, name)
        size = np.linalg.norm(values, axis=1)
        if name in ("quaternion", "error") or not np.isfinite(size).any():
            continue
        worst = int(np.nanargmax(size))
        bound = ", ".join(map(number, _limits(dataset, name))) or "–"
        when = number(float(dataset["time"].values[worst]))
        largest, heading = number(float(size[worst])), name.replace("_", " ")
        if (name == "command" and _of_each_axis(dataset)) or name == "momentum":
            limits = np.ravel(dataset[name].attrs.get("limit", [])).astype(float)
            bound = ", ".join(number(x) for x in _scale(dataset, name) * limits) or "–"
            largest, heading = (
                ", ".join(number(x) for x in np.nanmax(np.abs(values), axis=0)),
                f"{heading}, each {'wheel' if name == 'momentum' else 'axis'}",
            )
            when = "–"
        rows.append([f"{heading} [{symbol}]", largest, when, bound])
    note = (
        "Norms of vectors, or components if each axis or wheel has its own limit; only at the instants of the dataset."
    )
    return Table("Largest values", ["quantity", "largest", "at [s]", "limit"], rows, note=note)


def _ends(dataset: xarray.Dataset) -> Table:
    """Tabulate the attitude and the rate at the first and the last instant."""
    rows = []
    for text, end in (("start", 0), ("end", -1)):
        row = [text, number(float(dataset["time"].values[end]))]
        row += [f"{x + 0.0:.6f}" for x in dataset["quaternion"].values[end]]
        if "rate" in dataset:
            row += [number(x, 4) for x in _in_degrees(dataset, "rate")[0][end].tolist()]
        rows.append(row)
    header = ["", "t [s]", "λ₀", "λ₁", "λ₂", "λ₃", "ω₁ [°/s]", "ω₂ [°/s]", "ω₃ [°/s]"]
    return Table("Attitude at the ends", header[: len(rows[0])], rows)
