"""Fit a route through a few waypoints: the knots are their times, and the smoothing hardly changes the positions."""

import numpy as np

from qtraj.foundation.types import ArrayInput
from qtraj.path.track import Track, to_float64

FEW = 8
"""Number of samples below which a recording consists of waypoints: it is too short for cross-validation."""

SMOOTHING = 1e-9
"""Smoothing in units of the fifth power of the median time step."""


def knots_and_smoothing(
    track: Track, knots: ArrayInput | None, tolerance: float | None, smoothing: float | None
) -> tuple[ArrayInput | None, float | None]:
    """Return the knots [s] and the smoothing [s⁵]; for waypoints, those of the route with minimum jerk through them.

    **Raises:** ValueError for waypoints with one of the arguments.
    """
    times = to_float64(track.times)
    if len(times) >= FEW:
        return knots, smoothing
    if knots is not None or tolerance is not None or smoothing is not None:
        raise ValueError(
            f"a route needs at least {FEW} samples, but the track has {len(times)}: omit knots, tolerance and "
            "smoothing for a route through these waypoints"
        )
    return times - times[0], SMOOTHING * float(np.median(np.diff(times))) ** 5
