"""Check that a path can be timed as a lap, whose end is its start."""

from typing import Any

import numpy as np

from qtraj.foundation.arrays import is_traced
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.joined_ends import first_difference

SAMPLES = 65


def require_lap(path: AbstractHodograph, start_speed: Any, end_speed: Any) -> None:
    """Raise a ValueError if a path does not end as it starts, or if a speed at an end is given."""
    if start_speed is not None or end_speed is not None:
        raise ValueError(
            "a lap has the same speed at its start and its end, which the search chooses: omit start_speed and "
            "end_speed, or pass periodic=False"
        )
    if path.duration.ndim or is_traced(path):
        raise ValueError("periodic=True needs one path with concrete values; the limits may be traced")
    times = np.linspace(0.0, float(path.duration), SAMPLES)
    states = np.array([np.asarray(path.derivatives(t, 2), float) for t in times])
    order = first_difference(states, float(path.duration))
    if order is not None:
        what = ("position", "velocity", "acceleration")[order]
        raise ValueError(
            f"a lap must end as it starts, but the {what} of the path at its start and its end differs: use a closed "
            "shape, qtraj.Shape.through(points, closed=True), or pass periodic=False"
        )


def require_no_stops(lap: bool, parts: int, standing: bool) -> None:
    """Raise a ValueError if a `lap` has stops: a route with several `parts`, or `standing` at an end."""
    if lap and (parts > 1 or standing):
        raise ValueError(
            "a flying lap has no stops, but the vehicle is at rest on this route: pass periodic=False, or "
            "stop_speed=0 if it only moves slowly"
        )
