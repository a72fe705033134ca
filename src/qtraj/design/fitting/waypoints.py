"""Fit a route through a few waypoints: the knots are their times, and the smoothing hardly changes the positions."""

import numpy as np

from qtraj.path.track import Track, to_float64

FEW = 8
"""Number of samples below which a recording is read as waypoints: it is too short for cross-validation."""

SMOOTHING = 1e-12
"""Smoothing in units of the fifth power of the median time step."""


def waypoint_settings(track: Track) -> tuple[np.ndarray, float]:
    """Return the knots [s] and the smoothing [s⁵] of a route with minimum jerk through the samples of a track."""
    times = to_float64(track.times)
    return times - times[0], SMOOTHING * float(np.median(np.diff(times))) ** 5
