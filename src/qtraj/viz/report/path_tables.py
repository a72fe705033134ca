"""The tables of a report of paths: limits, boundary states, provenance."""

from collections.abc import Mapping

import numpy as np
import xarray

from qtraj.design.fitting.facts import FACTS, TITLE, fact_rows
from qtraj.design.proof.certificate import BINDING
from qtraj.design.tuning.outcome import Tuned
from qtraj.io.dataset import MAGNITUDES
from qtraj.path.boundary import BoundaryState, cylindrical
from qtraj.path.deviation import max_deviation
from qtraj.path.quantity import CORRIDOR
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.viz.report.model import Table, number, unit
from qtraj.viz.report.provenance import provenance_table

PROOFS = {
    "proved": "proved on the whole path",
    "sampled": "met on a refined grid whose peaks were polished; evidence, no proof",
    "broken": "the limit does not hold at the time given",
    "undecided": "too near to the limit to be decided in float64",
    "undefined": "the quantity does not exist at the time given",
}
"""What the findings of a certificate mean."""


def path_tables(dataset: xarray.Dataset, paths: Mapping[str, xarray.Dataset], tuned: Tuned | None) -> list[Table]:
    """All tables, those without rows left out."""
    velocities, provenance = _cylindrical(paths, tuned), provenance_table(dataset)
    found = [_fit(dataset), _limits(paths, tuned), _boundary(paths), velocities, _extent(paths), provenance]
    return [table for table in found if table.rows]


def _fit(dataset: xarray.Dataset) -> Table:
    """The fitted path against its recording, as the terminal shows it; without rows where nothing was fitted."""
    if "fit_axis" not in dataset:
        return Table(TITLE, ["", ""], [], 2)
    numbers = {name: float(dataset[f"fit_{name}"]) if f"fit_{name}" in dataset else None for name in FACTS}
    known = numbers | {"axis": dataset["fit_axis"].values[:2].tolist()}
    return Table(TITLE, ["", ""], [list(row) for row in fact_rows(known)], 2, str(dataset.attrs.get("fit_result", "")))


def _limits(paths: Mapping[str, xarray.Dataset], tuned: Tuned | None) -> Table:
    """Largest value of each limited magnitude: of the tuned path as certified, of others at the instants known."""
    rows = []
    for limit_name, name in MAGNITUDES.items():
        for label, path in paths.items():
            if name in path and "limit" in path[name].attrs:
                certified = tuned is not None and label == "after" and limit_name in tuned.certificate.names
                found = _certified(tuned, limit_name) if tuned is not None and certified else _known(path, name)
                heading = f"{limit_name.replace('_', ' ')} [{unit(path[name].attrs['units'])}]"
                rows.append([heading, label, *found])
    for label, path in paths.items():
        finding = f"finding_{CORRIDOR.name}"
        if finding in path and str(path[finding].values):
            rows.append([f"{CORRIDOR.name} [{CORRIDOR.label}]", label, *_known(path, CORRIDOR.name)])
    known = [f"{status}: {PROOFS[status]}" for status in dict.fromkeys(row[-1] for row in rows) if status in PROOFS]
    note = "; ".join(
        [*known, "without a certificate the largest value, within and broken are those of the sampled instants"]
    )
    return Table("Limits", ["limit", "path", "largest", "limit", "margin", "at [s]", ""], rows, 2, note + ".")


def _certified(tuned: Tuned, name: str) -> list[str]:
    certificate = tuned.certificate
    time, value, limit = certificate.worst[name]
    margin = "binds" if name in certificate.binding else number(limit - value, 3)
    return [number(value), number(limit), margin, number(time, 4), certificate.status[name]]


def _known(path: xarray.Dataset, name: str) -> list[str]:
    """By the findings that stand in the dataset; of a path without, at the sampled instants."""
    finding = str(path[f"finding_{name}"].values) if f"finding_{name}" in path else ""
    if finding not in PROOFS:
        return _sampled(path, name)
    value, time = (float(path[f"largest_{name}{suffix}"]) for suffix in ("", "_time"))
    limit = float(path[f"largest_{name}"].attrs["limit"])
    binds = finding in ("proved", "sampled") and limit - value <= BINDING * limit
    margin = "binds" if binds else number(limit - value, 3)
    return [number(value), number(limit), margin, number(time, 4), finding]


def _sampled(path: xarray.Dataset, name: str) -> list[str]:
    values, limit = np.abs(path[name].values), float(path[name].attrs["limit"])
    if not np.isfinite(values).any():
        return ["–", number(limit), "–", "–", "undefined"]
    worst = int(np.nanargmax(values))
    value, time = float(values[worst]), float(path["time"].values[worst])
    verdict = "within" if value <= limit else "broken"
    return [number(value), number(limit), number(limit - value, 3), number(time, 4), verdict]


def _boundary(paths: Mapping[str, xarray.Dataset]) -> Table:
    """Position and velocity at the ends A and B of each path, in world axes."""
    rows = []
    for label, path in paths.items():
        if "velocity" not in path:
            continue
        for letter, end in (("A", 0), ("B", -1)):
            position, velocity = path["position"].values[end], path["velocity"].values[end]
            row = [*position, *velocity, np.linalg.norm(velocity)]
            rows.append([f"{label} {letter}", *(f"{x + 0.0:.4f}" for x in row)])
    header = ["state", "x [m]", "y [m]", "z [m]", "vx [m/s]", "vy [m/s]", "vz [m/s]", "speed [m/s]"]
    return Table("Boundary states, world axes", header, rows)


def _cylindrical(paths: Mapping[str, xarray.Dataset], tuned: Tuned | None) -> Table:
    """Boundary velocities about the axis of the tuned path: its own, and those of the path before where it is known."""
    rows = []
    if tuned is not None and isinstance(tuned.path, SpiralHelix):
        states = {"after A": tuned.start, "after B": tuned.end}
        before = paths.get("before")
        if before is not None and "velocity" in before:
            position, velocity = before["position"].values, before["velocity"].values
            known = {f"before {letter}": BoundaryState(position[k], velocity[k]) for letter, k in (("A", 0), ("B", -1))}
            states = known | states
        for label, state in states.items():
            found = cylindrical(state, tuned.path.placement)
            rows.append([label, *(f"{float(v) + 0.0:.4f}" for v in (found.radius, *found.velocity))])
    header = ["state", "ρ [m]", "V_ρ [m/s]", "V_φ [m/s]", "V_h [m/s]"]
    return Table("Boundary velocities about the axis of the path", header, rows)


def _extent(paths: Mapping[str, xarray.Dataset]) -> Table:
    """Duration, length, and how far each path leaves the first one."""
    rows, (first, line) = [], next(iter(paths.items()))
    for label, path in paths.items():
        time = path["time"].values
        length = np.trapezoid(path["speed"].values, time) if "speed" in path else np.nan
        apart = max_deviation(path["position"].values, line["position"].values)
        rows.append([label, number(float(time[-1])), number(float(length), 5), number(apart, 3), str(len(time))])
    header = ["path", "duration [s]", "length [m]", f"farthest from {first} [m]", "instants"]
    return Table("Duration and length", header, rows)
