"""Convert a report to JSON types for the script of its page, with fewer samples and with shifted positions."""

from typing import Any

import numpy as np

from qtraj.viz.extent import beside, box
from qtraj.viz.map_colours import MapColours
from qtraj.viz.report.model import Body, Panel, Report, plain, thinned
from qtraj.viz.report.ranges import HEADROOM, spike

ARROW = 0.17
"""Length of the arrows of a trihedral, divided by the largest extent of the paths."""
THICK, THIN = 2.0, 1.3
LABEL = 1.15
"""Distance of an arrow's label from the origin of the arrow, divided by the length of the arrow."""
MIN_EXTENT = 0.2
"""Minimum range of a coordinate, divided by the largest extent."""
MARGIN = 0.04
"""Margin on both sides of the paths and arrows, divided by the largest extent."""


def payload(report: Report) -> dict[str, Any]:
    """Return all data that the script of the page needs."""
    drawn = [thinned(len(body.time)) for body in report.bodies]
    space = _paths_space(report) if report.kind == "path" else {"length": 1.0, "range": [[-1.2, 1.2]] * 3}
    centre = np.array(space.get("centre", [0.0, 0.0, 0.0]))
    return {
        "kind": report.kind,
        "space": space,
        "arrows": [{"symbol": a.symbol, "meaning": a.meaning, "colour": a.colour} for a in report.arrows],
        "bodies": [_body(body, rows, centre) for body, rows in zip(report.bodies, drawn, strict=True)],
        "recorded": None if report.recorded is None else plain(report.recorded[thinned(len(report.recorded))] - centre),
        "colours": None if report.colours is None else _colours(report.colours, drawn[0]),
        "panels": [_panel(panel, drawn) for panel in report.panels],
    }


def _paths_space(report: Report) -> dict[str, Any]:
    """Return the common centre, the axis ranges relative to the centre, and the length of the arrows [m].

    The centre is rounded to metres. It is zero if its distance from the origin is small compared with the paths. `plan`
    are the ranges of the view from above, which contains the paths without their arrows.
    """
    paths = [body.position for body in report.bodies if body.position is not None]
    if report.recorded is not None:
        paths.append(beside(report.recorded, paths))
    low, high = box(paths)
    size = float((high - low).max()) or 1.0
    middle = (low + high) / 2
    centre = np.round(middle) if np.abs(middle).max() > 10 * size else np.zeros(3)
    length = ARROW * size
    plan = _ranges(low, high, size, centre)[:2]
    tips = [body.position[:, None] + LABEL * length * body.axes for body in report.bodies if body.position is not None]
    ranges = _ranges(*box([*paths, *tips]), size, centre)
    return {"centre": plain(centre), "range": plain(ranges), "plan": plain(plan), "length": length}


def _ranges(low: np.ndarray, high: np.ndarray, size: float, centre: np.ndarray) -> np.ndarray:
    """Return the ranges (3, 2) of a box with a margin, relative to the centre."""
    middle, half = (low + high) / 2, np.maximum(high - low, MIN_EXTENT * size) / 2 + MARGIN * size
    return np.stack([middle - centre - half, middle - centre + half], axis=1)


def _body(body: Body, rows: np.ndarray, centre: np.ndarray) -> dict[str, Any]:
    return {
        "name": body.name,
        "time": plain(body.time[rows]),
        "position": None if body.position is None else plain(body.position[rows] - centre),
        "axes": plain(body.axes[rows].reshape(-1, 9)),
        "colour": body.colour,
        "dash": body.dash,
        "ghost": body.ghost,
        "way": None if body.way is None else plain(body.way[rows]),
    }


def _colours(colours: MapColours, rows: np.ndarray) -> dict[str, Any]:
    return {"values": plain(colours.values[rows]), "top": colours.top}


def _panel(panel: Panel, drawn: list[np.ndarray]) -> dict[str, Any]:
    peak = max((float(np.nanmax(np.abs(line.values), initial=0.0)) for line in panel.series), default=0.0)
    cut = None if panel.logarithmic else spike([line.values for line in panel.series])
    peak = peak if cut is None else cut[0] / HEADROOM
    return {
        "title": panel.title,
        "unit": panel.unit,
        "logarithmic": panel.logarithmic,
        "along": panel.along,
        "range": _range(panel, cut),
        "note": panel.note or ("" if cut is None else f"larger values, up to {cut[1]:.3g}, are not shown"),
        "limits": [
            {"value": value, "text": text, "drawn": abs(value) <= HEADROOM * peak} for value, text in panel.limits
        ],
        "series": [
            {
                "name": line.name,
                "body": line.body,
                "values": plain(line.values[drawn[line.body]]),
                "colour": line.colour,
                "dash": line.dash,
                "width": THIN if line.reference else THICK,
                "follows": line.follows,
                "reference": line.reference,
                "listed": line.name not in [other.name for other in panel.series[:k] if other.reference],
            }
            for k, line in enumerate(panel.series)
        ],
    }


def _range(panel: Panel, cut: tuple[float, float] | None) -> list[float] | None:
    """Return the axis range, which shows all values except spikes, or None if it follows from the values."""
    if panel.shown is not None:
        return list(panel.shown)
    if cut is None:
        return None
    negative = any(float(np.nanmin(line.values, initial=0.0)) < 0 for line in panel.series)
    return [-cut[0] if negative else 0.0, cut[0]]
