"""Plot the bank and the friction of a road that changes along the way, in panels against the distance."""

from typing import Any

import numpy as np
import xarray

from qtraj.path.road import Road
from qtraj.path.vehicle_data import vehicle_from
from qtraj.viz.style import COLOURS

BANK, FRICTION = "bank of the road", "friction of the road"
"""The names of the panels."""


def road_panels(dataset: xarray.Dataset) -> dict[str, str]:
    """Return the panels of the road in a dataset with a vehicle, and their labels; none without such a road."""
    road = _road(dataset)
    if road is None or road.is_constant:
        return {}
    given = {BANK: (road.bank, "bank of\nthe road [°]"), FRICTION: (road.friction, "friction of\nthe road [-]")}
    return {name: label for name, (values, label) in given.items() if values is not None}


def draw_road(axes: Any, dataset: xarray.Dataset, distance: np.ndarray, at: np.ndarray, panel: str) -> None:
    """Plot the bank or the friction of the road at distances [m], against `at`."""
    road: Any = _road(dataset)
    surface = road.at(distance)
    style = {"color": COLOURS["after"], "lw": 1.0}
    if panel == BANK:
        axes.plot(at, np.degrees(surface.bank), **style)
        return
    axes.plot(at, surface.along, label="along the vehicle", **style)
    if not np.array_equal(surface.along, surface.across):
        axes.plot(at, surface.across, label="across", **{**style, "ls": "--"})
        axes.legend(loc="best", fontsize=7)
    axes.set_ylim(0.0, 1.1 * max(map(max, road.friction)))


def _road(dataset: xarray.Dataset) -> Road | None:
    vehicle = vehicle_from({str(name): x.values for name, x in dataset.data_vars.items()})
    return None if vehicle is None else vehicle.road
