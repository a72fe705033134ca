"""Where the joints of a fitted route stand, and where the vehicle stands still."""

import numpy as np
from jaxtyping import Bool, Float

from qtraj.path.track import STANDSTILL

SLOW = 0.005
"""A vehicle that stands is slower than this part of its largest speed."""

LEAST_STOP = 1.0
"""[s] A stop lasts at least so long, and at least a few steps of time."""

NEAR = 0.2
"""Joints nearer to a stop than this part of their spacing are left out."""


def standing(
    times: Float[np.ndarray, " n"], positions: Float[np.ndarray, "n 3"], speeds: Float[np.ndarray, " n"], step: float
) -> list[tuple[float, float]]:
    """The intervals (start, end) [s] in which a vehicle stands: it is slow, and stays within `STANDSTILL` [m]."""
    slow = np.concatenate([[False], speeds <= SLOW * speeds.max(), [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    found = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        part = positions[first : last + 1]
        still = np.linalg.norm(part - part.mean(axis=0), axis=1).max() <= STANDSTILL
        if still and times[last] - times[first] >= max(LEAST_STOP, 4 * step):
            found.append((float(times[first]), float(times[last])))
    return found


def even(duration: float, spacing: float) -> Float[np.ndarray, " m"]:
    """Knots at equal steps of about `spacing` [s]."""
    return np.linspace(0.0, duration, max(1, round(duration / spacing)) + 1)


def with_stops(
    knots: Float[np.ndarray, " m"], stops: list[tuple[float, float]]
) -> tuple[Float[np.ndarray, " k"], Bool[np.ndarray, " segments"]]:
    """Knots at the ends of stops and none within or next to them, and which segments are stops."""
    near = NEAR * float(np.median(np.diff(knots)))
    ends = np.array(stops).ravel()
    kept = np.ones(len(knots), bool)
    for start, end in stops:
        kept &= (knots < start - near) | (knots > end + near)
    first, last = knots[0], knots[-1]
    found = np.unique(np.concatenate([[first], knots[kept], ends, [last]]))
    held = np.zeros(len(found) - 1, bool)
    held[np.searchsorted(found, np.array([start for start, _ in stops], float))] = True
    return found, held
