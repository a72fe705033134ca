"""Represent a report as plain data: moving bodies, panels over time, tables."""

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from qtraj.foundation import units
from qtraj.path.quantity import COMBINED, QUANTITIES, SIDES
from qtraj.viz.map_colours import MapColours
from qtraj.viz.report.along import distance_travelled

MAX_INSTANTS = 2001
"""Maximum number of instants drawn for one body; longer series are thinned evenly, and both ends are kept."""

NAMES = re.compile(rf"\b(?:{'|'.join((*SIDES, *QUANTITIES, COMBINED))}|max_(?:rate|acceleration|jerk))\b")
"""The names of limits on paths and on slews."""


@dataclass(frozen=True)
class Arrow:
    """An axis of a body: its symbol, its meaning and its colour."""

    symbol: str
    meaning: str
    colour: str


@dataclass(frozen=True)
class Body:
    """A moving body: instants (n,) [s], positions (n, 3) [m] or None, and three axes at each instant (n, 3, 3).

    Missing positions and axes are NaN. A ghost is drawn pale, for comparison with the selected body.
    """

    name: str
    time: np.ndarray
    position: np.ndarray | None
    axes: np.ndarray
    colour: str
    dash: str = "solid"
    ghost: bool = False

    @property
    def way(self) -> np.ndarray | None:
        """The distance travelled (n,) [m] at each instant, or None without positions."""
        return None if self.position is None else distance_travelled(self.position)


@dataclass(frozen=True)
class Series:
    """One line of a panel, with values (n,) over the instants of body number `body`.

    If `follows` is true, the line is shown only while its body is selected. A `reference` is drawn as a thin line, for
    comparison. If several references in a panel have the same name, only the first is in the legend.
    """

    name: str
    body: int
    values: np.ndarray
    colour: str
    dash: str = "solid"
    follows: bool = False
    reference: bool = False


@dataclass(frozen=True)
class Panel:
    """Lines with a common unit over time or, with `along`, over the distance travelled; limits are (value, label).

    `shown` is the range of the vertical axis, or None if it follows from the values. `note` is a text about values that
    are outside this range.
    """

    title: str
    unit: str
    series: list[Series]
    limits: list[tuple[float, str]] = field(default_factory=list)
    logarithmic: bool = False
    along: bool = False
    shown: tuple[float, float] | None = None
    note: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of strings. Columns from index `numbers` on are aligned as numbers; the last column may be a status.

    `jumps` are the times [s] of each row on each body, to which the first cell of the row moves the clock. A table with
    jumps stays beside the scene.
    """

    title: str
    header: list[str]
    rows: list[list[str]]
    numbers: int = 1
    note: str = ""
    jumps: list[list[float]] | None = None


@dataclass(frozen=True)
class Report:
    """A complete report; `kind` is "path" or "attitude".

    `recorded` (m, 3) are recorded points. `colours` are the map colours of a single path at its instants. `warnings`
    are shown in red above the `notes`.
    """

    title: str
    kind: str
    facts: list[str]
    arrows: list[Arrow]
    bodies: list[Body]
    panels: list[Panel]
    tables: list[Table]
    recorded: np.ndarray | None = None
    colours: MapColours | None = None
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """Return a summary as plain data: title, kind, findings, bodies, panels, tables, notes, warnings."""
        bodies = [{"name": x.name, "instants": len(x.time), "duration": float(x.time[-1])} for x in self.bodies]
        return {
            "title": self.title,
            "kind": self.kind,
            "findings": self.facts,
            "bodies": bodies,
            "panels": [panel.title for panel in self.panels],
            "tables": [table.title for table in self.tables],
            "notes": self.notes,
            "warnings": self.warnings,
        }


def unit(text: str) -> str:
    """Return a unit in display form, for example "m/s²" for "m s-2"."""
    return units.symbol(text) or "–" if text else ""


def words(text: str) -> str:
    """Replace names of limits in a text by words, for example "lateral_acceleration" by "lateral acceleration"."""
    return NAMES.sub(lambda name: name[0].replace("_", " "), text)


def sentence(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def number(value: float, digits: int = 6) -> str:
    """Format a number, or return a dash if it is not finite."""
    return f"{value + 0.0:.{digits}g}" if math.isfinite(value) else "–"


def thinned(count: int) -> np.ndarray:
    """Return the indices of the drawn instants among `count` instants."""
    return np.unique(np.linspace(0, count - 1, min(count, MAX_INSTANTS)).round().astype(int))


def plain(values: np.ndarray) -> list[Any]:
    """Convert values, rounded to nine significant digits, to nested lists, with None for values that are not finite."""
    if values.ndim > 1:
        return [plain(row) for row in values]
    return [float(f"{v:.9g}") if math.isfinite(v) else None for v in values.tolist()]
