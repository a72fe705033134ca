"""Choose the knots of a fitted route, and detect stops."""

import numpy as np
from jaxtyping import Bool, Float

from qtraj.path.track import STANDSTILL

STOP_SPEED = 0.005
"""Maximum speed at a stop, relative to the largest speed of the recording."""

MIN_STOP, MIN_STEPS = 1.0, 4
"""Minimum duration of a stop, in seconds and in time steps of the recording; the longer one applies."""

MIN_DISTANCE = 0.2
"""Minimum distance of a knot from a stop, in knot spacings; closer knots are removed."""


def find_stops(
    times: Float[np.ndarray, " n"], positions: Float[np.ndarray, "n 3"], speeds: Float[np.ndarray, " n"], step: float
) -> list[tuple[float, float]]:
    """Return the stops as intervals (start, end) [s].

    At a stop the vehicle is slow and stays within `STANDSTILL` [m] of its mean position for the minimum duration.
    """
    slow = np.concatenate([[False], speeds <= STOP_SPEED * speeds.max(), [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    intervals = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        part = positions[first : last + 1]
        stays = np.linalg.norm(part - part.mean(axis=0), axis=1).max() <= STANDSTILL
        if stays and times[last] - times[first] >= max(MIN_STOP, MIN_STEPS * step):
            intervals.append((float(times[first]), float(times[last])))
    return intervals


def equal_knots(duration: float, spacing: float) -> Float[np.ndarray, " m"]:
    """Return knots from 0 to the duration at equal intervals of about `spacing` [s]."""
    return np.linspace(0.0, duration, max(1, round(duration / spacing)) + 1)


def with_stops(
    knots: Float[np.ndarray, " m"], stops: list[tuple[float, float]]
) -> tuple[Float[np.ndarray, " k"], Bool[np.ndarray, " segments"]]:
    """Replace the knots inside or close to a stop by the ends of the stop.

    Returns the new knots, and for each segment whether it is a stop.
    """
    near = MIN_DISTANCE * float(np.median(np.diff(knots)))
    ends = np.array(stops).ravel()
    kept = np.ones(len(knots), bool)
    for start, end in stops:
        kept &= (knots < start - near) | (knots > end + near)
    first, last = knots[0], knots[-1]
    result = np.unique(np.concatenate([[first], knots[kept], ends, [last]]))
    is_stop = np.zeros(len(result) - 1, bool)
    is_stop[np.searchsorted(result, np.array([start for start, _ in stops], float))] = True
    return result, is_stop
