"""Create the tables of a report on paths: limits, boundary states, provenance."""

from collections.abc import Collection, Mapping

import numpy as np
import xarray

from qtraj.design.fitting.facts import FACTS, TITLE, fact_rows
from qtraj.design.fitting.route_facts import TITLE as ROUTE_TITLE
from qtraj.design.proof.certificate import ACTIVE_MARGIN
from qtraj.design.tuning.outcome import Tuned
from qtraj.io.dataset import LIMIT_VARIABLES, bounded_values, limit_attribute
from qtraj.io.findings import FINDING, finding_names
from qtraj.io.route_dataset import ROUTE_FACT, ROUTE_FACT_TEXT
from qtraj.path.boundary import BoundaryState, cylindrical
from qtraj.path.deviation import max_deviation
from qtraj.path.quantity import QUANTITIES, quantity
from qtraj.path.sides import upper_side
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.vehicle_data import PREFIX
from qtraj.viz.report.model import Table, number, sentence, unit
from qtraj.viz.report.provenance import provenance_table

PROOFS = {
    "proved": "proved on the whole path",
    "sampled": "satisfied on a refined grid with refined maxima, which is evidence but not a proof",
    "broken": "the limit is violated at the time shown",
    "undecided": "the largest value equals the limit to within rounding error, or the quantity is not proved to be "
    "defined everywhere",
    "undefined": "the quantity is not defined at the time shown",
}
"""Meaning of each status of a certificate."""


def path_tables(dataset: xarray.Dataset, paths: Mapping[str, xarray.Dataset], tuned: Tuned | None) -> list[Table]:
    """Return all tables that are not empty."""
    velocities, provenance = _cylindrical(paths, tuned), provenance_table(dataset)
    tables = [
        _fit(dataset),
        _limits(paths, tuned),
        _vehicle(dataset),
        _reached(dataset),
        _boundary(paths),
        velocities,
        _extent(paths),
        provenance,
    ]
    return [table for table in tables if table.rows]


def _fit(dataset: xarray.Dataset) -> Table:
    """Tabulate the comparison of the fitted path with its recording, or return an empty table if there is no fit."""
    if ROUTE_FACT_TEXT in dataset:
        pairs = zip(dataset[ROUTE_FACT].values, dataset[ROUTE_FACT_TEXT].values, strict=True)
        return Table(ROUTE_TITLE, ["", ""], [[str(name), str(text)] for name, text in pairs], 2)
    if "fit_axis" not in dataset:
        return Table(TITLE, ["", ""], [], 2)
    numbers = {name: float(dataset[f"fit_{name}"]) if f"fit_{name}" in dataset else None for name in FACTS}
    facts = numbers | {"axis": dataset["fit_axis"].values[:2].tolist()}
    note = sentence(str(dataset.attrs.get("fit_result", "")))
    return Table(TITLE, ["", ""], [list(row) for row in fact_rows(facts)], 2, note)


def _vehicle(dataset: xarray.Dataset) -> Table:
    """Tabulate the parameters of the vehicle; the table is empty without a vehicle."""
    rows = []
    for name in (str(name) for name in dataset.data_vars if str(name).startswith(PREFIX)):
        values, about = dataset[name], dataset[name].attrs
        text = ", ".join(number(float(x)) for x in values.values.ravel())
        rows.append([f"{about['long_name']} [{unit(about.get('units', ''))}]", text])
    return Table("Vehicle", ["parameter", "value"], rows)


def _limits(paths: Mapping[str, xarray.Dataset], tuned: Tuned | None) -> Table:
    """Tabulate the worst value of each limited quantity, from the certificate or at the sampled instants."""
    rows = []
    names = () if tuned is None else tuned.certificate.names
    for limit_name, name in _limits_by_variable(names):
        for label, path in paths.items():
            attribute = limit_attribute(limit_name)
            if name in path and (attribute in path[name].attrs or f"{name}_{attribute}" in path):
                certified = tuned is not None and label == "after" and limit_name in names
                cells = _certified(tuned, limit_name) if tuned is not None and certified else _stored(path, limit_name)
                heading = f"{limit_name.replace('_', ' ')} [{unit(path[name].attrs['units'])}]"
                rows.append([heading, label, *cells])
    rows += _others(paths)
    meanings = [f"{status}: {PROOFS[status]}" for status in dict.fromkeys(row[-1] for row in rows) if status in PROOFS]
    note = "; ".join(
        [
            *meanings,
            'without a certificate, the largest value, "within" and "broken" refer to the sampled instants only',
        ]
    )
    header = ["limit", "path", "worst value", "limit", "margin", "at [s]", ""]
    return Table("Limits", header, rows, 2, sentence(note) + ".")


def _others(paths: Mapping[str, xarray.Dataset]) -> list[list[str]]:
    """Return rows for findings on limits that are not in the registry: obstacles, a corridor and own quantities."""
    rows = []
    for status in dict.fromkeys(
        str(x) for path in paths.values() for x in path.data_vars if str(x).startswith(FINDING)
    ):
        for label, path in paths.items():
            name = str(path[status].attrs.get("limit_name", "")) if status in path else ""
            if not name or name in LIMIT_VARIABLES or not str(path[status].values):
                continue
            variable = status.removeprefix(FINDING)
            extreme = next(x for x in (variable, f"largest_{variable}", f"smallest_{variable}") if f"{x}_time" in path)
            heading = f"{name.replace('_', ' ')} [{unit(path[extreme].attrs['units'])}]"
            rows.append([heading, label, *_found(path, extreme, str(path[status].values))])
    return rows


def _limits_by_variable(certified: Collection[str]) -> list[tuple[str, str]]:
    """Return names of limits and the variables that they bound, without limits that the dataset cannot distinguish.

    An upper bound and a number may have the same variable; then the name among those in a certificate counts.
    """
    twins = {x.name: upper_side(x) for x in QUANTITIES.values() if LIMIT_VARIABLES[upper_side(x)] == x.variable}
    twins = {name: other for name, other in twins.items() if name != other}
    dropped = {name if other in certified else other for name, other in twins.items()}
    return [(name, variable) for name, variable in LIMIT_VARIABLES.items() if name not in dropped]


def _certified(tuned: Tuned, name: str) -> list[str]:
    certificate = tuned.certificate
    time, value, limit = certificate.worst[name]
    margin = "active" if name in certificate.active else number(certificate.margin(name), 3)
    return [number(value), number(limit), margin, number(time, 4), certificate.status[name]]


def _stored(path: xarray.Dataset, limit_name: str) -> list[str]:
    """Return the cells of a row from the finding in the dataset or, without a finding, from the samples."""
    extreme, status = finding_names(limit_name)
    finding = str(path[status].values) if status in path else ""
    return _found(path, extreme, finding) if finding in PROOFS else _sampled(path, limit_name)


def _found(path: xarray.Dataset, extreme: str, finding: str) -> list[str]:
    """Return the cells of a row from the variable with the worst value."""
    value, time = (float(path[f"{extreme}{suffix}"]) for suffix in ("", "_time"))
    own = f"{extreme}_limit"
    limit = float(path[own]) if own in path else float(path[extreme].attrs["limit"])
    margin = limit - value if extreme.startswith("largest") else value - limit
    active = finding in ("proved", "sampled") and margin <= ACTIVE_MARGIN * (abs(limit) or 1.0)
    return [number(value), number(limit), "active" if active else number(margin, 3), number(time, 4), finding]


def _sampled(path: xarray.Dataset, limit_name: str) -> list[str]:
    name, side = LIMIT_VARIABLES[limit_name], quantity(limit_name).side
    values, attribute = bounded_values(name, path[name].values), limit_attribute(limit_name)
    along = path.get(f"{name}_{attribute}")
    limits = np.full(values.shape, float(path[name].attrs[attribute])) if along is None else along.values
    if not np.isfinite(values).any():
        return ["–", number(float(limits[0])), "–", "–", "undefined"]
    worst = int(np.nanargmax(side * (values - limits)))
    value, time, limit = float(values[worst]), float(path["time"].values[worst]), float(limits[worst])
    margin = side * (limit - value)
    return [number(value), number(limit), number(margin, 3), number(time, 4), "within" if margin >= 0 else "broken"]


def _reached(dataset: xarray.Dataset) -> Table:
    """Return the table of the limits that bound the speed of a retimed path; it is empty for other paths."""
    title, header = "Limits that bound the speed", ["limit", "reached on"]
    if "reached_share" not in dataset:
        return Table(title, header, [])
    share = dataset["reached_share"]
    names = [str(name).replace("_", " ") for name in share["limit"].values]
    rows = [[name, f"{100 * value:.1f} %"] for name, value in zip(names, share.values.tolist(), strict=True)]
    note = (
        "Fraction of the distance on which a quantity is within 1 % of its limit; several quantities may reach their "
        "limits at the same position."
    )
    return Table(title, header, rows, 1, note)


def _boundary(paths: Mapping[str, xarray.Dataset]) -> Table:
    """Tabulate position and velocity at the ends A and B of each path, in world axes."""
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
    """Tabulate the boundary velocities of both paths in cylindrical coordinates about the axis of the tuned path."""
    rows = []
    if tuned is not None and isinstance(tuned.path, SpiralHelix):
        states = {"after A": tuned.start, "after B": tuned.end}
        before = paths.get("before")
        if before is not None and "velocity" in before:
            position, velocity = before["position"].values, before["velocity"].values
            ends = {f"before {letter}": BoundaryState(position[k], velocity[k]) for letter, k in (("A", 0), ("B", -1))}
            states = ends | states
        for label, state in states.items():
            components = cylindrical(state, tuned.path.placement)
            rows.append([label, *(f"{float(v) + 0.0:.4f}" for v in (components.radius, *components.velocity))])
    header = ["state", "ρ [m]", "V_ρ [m/s]", "V_φ [m/s]", "V_h [m/s]"]
    return Table("Boundary velocities about the axis of the path", header, rows)


def _extent(paths: Mapping[str, xarray.Dataset]) -> Table:
    """Tabulate the duration and the length of each path, and its largest distance from the first path."""
    rows, (first, line) = [], next(iter(paths.items()))
    for label, path in paths.items():
        time = path["time"].values
        length = np.trapezoid(path["speed"].values, time) if "speed" in path else np.nan
        distance = max_deviation(path["position"].values, line["position"].values)
        rows.append([label, number(float(time[-1])), number(float(length), 5), number(distance, 3), str(len(time))])
    header = ["path", "duration [s]", "length [m]", f"farthest from {first} [m]", "instants"]
    return Table("Duration and length", header, rows)
