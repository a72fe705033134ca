"""Bound the difference between the distance along a path and its chord in intervals of the parameter."""

import numpy as np
from jaxtyping import Float

from qtraj.path.distances import Distances
from qtraj.path.pace_bounds import pace_bounds
from qtraj.path.route import Route

SAMPLES, RESERVE = 9, 1.25
"""On a path that is not polynomial, the number of points in an interval at which the distance is compared with its
chord, and the factor on the largest difference."""

ROUNDINGS = 8
"""An end of an interval beyond the joint of a route by less than this number of roundings is at the joint."""


def chord_gaps(on: Distances, low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the largest difference [m] between the distance and its chord in intervals; infinite at a joint.

    It is at most (high − low)²/8 times the largest derivative of |r'|, which is bounded for polynomial paths. On other
    paths, it is sampled.
    """
    if isinstance(on.path, Route):
        low, high = within_segments(on.path, low, high)
    bounds = pace_bounds(on.path, low, high)
    if bounds is not None:
        return np.where(high > low, bounds.change * (high - low) ** 2 / 8, 0.0)
    z = np.linspace(0.0, 1.0, SAMPLES)
    u = low[:, None] + (high - low)[:, None] * z
    first, last = on.at(low), on.at(high)
    chord = first[:, None] + (last - first)[:, None] * z
    return RESERVE * np.max(np.abs(on.at(u.ravel()).reshape(u.shape) - chord), axis=1)


def within_segments(route: Route, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return intervals whose ends are not beyond a joint because of rounding errors."""
    times = np.asarray(route.times, float)
    row = np.clip(np.searchsorted(times, 0.5 * (low + high), side="right") - 1, 0, times.size - 2)
    start, end, near = times[row], times[row + 1], ROUNDINGS * np.finfo(float).eps * times[-1]
    low = np.where((low < start) & (low > start - near), start, low)
    return low, np.where((high > end) & (high < end + near), end, high)
