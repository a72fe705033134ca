"""Heading and curvature of a race line, and their differences from a path that was fitted to its positions."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.io.track.column_names import find, unit_in
from qtraj.io.track.column_units import Unit, unit_of
from qtraj.io.track.time_column import Table
from qtraj.path.hodograph import AbstractHodograph

HEADINGS, CURVATURES = ("psi",), ("kappa_radpm", "kappa", "curvature_radpm", "curvature")
MIN_SPEED = 0.01
"""Heading and curvature are compared where the horizontal speed exceeds this fraction of its maximum."""


class RecordedLine(NamedTuple):
    """Heading and curvature at the samples of a race line; None for a quantity without a column.

    `times` (n,) [s]: on the clock of the track. `heading` (n,) [rad]: the direction of travel from the x axis, positive
    to the left. `curvature` (n,) [1/m]: in the horizontal plane, positive to the left. `columns`: the columns of the
    heading and of the curvature.
    """

    times: Float[np.ndarray, " n"]
    heading: Float[np.ndarray, " n"] | None
    curvature: Float[np.ndarray, " n"] | None
    columns: tuple[str | None, str | None]

    def part(self, chosen: slice) -> "RecordedLine":
        """Return some of the samples."""
        values = [None if x is None else x[chosen] for x in (self.heading, self.curvature)]
        return self._replace(times=self.times[chosen], heading=values[0], curvature=values[1])

    def text(self) -> str:
        """Return which columns were read, in which units and as what."""
        meanings = ("rad, 0 along +y, positive to the left", "1/m, positive to the left")
        parts = zip(("heading", "curvature"), self.columns, meanings, strict=True)
        return "; ".join(f"{what}: {name}, {meaning}" for what, name, meaning in parts if name is not None)


class LineResidual(NamedTuple):
    """Root mean squares of the differences of heading [rad] and curvature [1/m]; None for what was not recorded."""

    heading_rms: float | None
    curvature_rms: float | None
    samples: int

    def rows(self) -> list[tuple[str, str]]:
        """Return the differences as pairs of a name and a text."""
        values = (("heading", self.heading_rms, "rad"), ("curvature", self.curvature_rms, "1/m"))
        return [(name, f"differs by {rms:.3g} {unit} RMS") for name, rms, unit in values if rms is not None]


def recorded_line(table: Table, times: Float[np.ndarray, " n"]) -> RecordedLine | None:
    """Return heading and curvature of a race line, or None without such columns.

    The columns have the conventions of race lines with the names psi and kappa: the heading is 0 along the y axis, and
    both are positive to the left. Columns with cells that are not numbers are omitted.
    """
    heading, curvature = _numbers(table, HEADINGS), _numbers(table, CURVATURES)
    if heading is None and curvature is None:
        return None
    angle = None if heading is None else heading[1] * _radians(table, heading[0]) + np.pi / 2
    columns = (None if heading is None else heading[0], None if curvature is None else curvature[0])
    return RecordedLine(times, angle, None if curvature is None else curvature[1], columns)


def line_residual(path: AbstractHodograph, line: RecordedLine, start: float) -> LineResidual:
    """Compare a path with heading and curvature of a race line; `start` [s] is the time of the path's start.

    Samples outside the path, and those at which the path hardly moves horizontally, are not compared.
    """
    from qtraj.batch.evaluate import evaluate  # imported here, because it delays the reading of files

    times, duration = line.times - start, float(path.duration)
    tolerance = 1e-6 * duration
    inside = (times >= -tolerance) & (times <= duration + tolerance)
    table: Any = evaluate(path, np.clip(times[inside], 0.0, duration), outputs=("velocity", "acceleration"))
    (vx, vy), (ax, ay) = (np.asarray(x, float)[:, :2].T for x in (table.velocity, table.acceleration))
    speed = np.hypot(vx, vy)
    moving = speed > MIN_SPEED * speed.max(initial=0.0)
    fitted = np.arctan2(vy, vx), (vx * ay - vy * ax) / np.where(moving, speed, 1.0) ** 3
    heading, curvature = (
        None if recorded is None else (recorded[inside] - own)[moving]
        for recorded, own in zip((line.heading, line.curvature), fitted, strict=True)
    )
    wrapped = None if heading is None else np.angle(np.exp(1j * heading))
    return LineResidual(_rms(wrapped), _rms(curvature), int(moving.sum()))


def _rms(values: np.ndarray | None) -> float | None:
    return None if values is None or not values.size else float(np.sqrt(np.mean(values**2)))


def _numbers(table: Table, names: tuple[str, ...]) -> tuple[str, np.ndarray] | None:
    """Return the name and the values of a column, or None if there is none with numbers in all cells."""
    found = find(names, table.header)
    values = None if found is None else table.quick(found)
    return None if found is None or values is None or not np.isfinite(values).all() else (found[0], values[:, 0])


def _radians(table: Table, name: str) -> float:
    """Return the factor that converts a column of angles to radians, by the unit in its name or below the header."""
    rows: Mapping[str, str] = dict(zip(table.header, table.units or [], strict=False))
    item = unit_in(name)
    unit: Unit | None = unit_of(rows.get(name, "")) if item is None else item[1]
    return 1.0 if unit is None or unit.kind != "angle" else float(unit.factor) * np.pi / 180
