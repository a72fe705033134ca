"""Detect the stops of a recorded drive."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_jumps import lengths
from qtraj.design.fitting.route_knots import read_knots
from qtraj.design.fitting.route_outliers import SMOOTHING
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve

SLOW = 0.005
"""Default of the maximum speed at a stop, relative to the largest speed of the recording."""

MIN_STOP, MIN_STEPS = 1.0, 4
"""Minimum duration of a stop, in units of time and in time steps of the recording; the longer one applies."""


class Standing(NamedTuple):
    """What counts as a stop: the speed (None for the default) and the distance from the mean position, in own units."""

    speed: float | None
    distance: float


def find_stops(recording: Recording, standing: Standing) -> list[tuple[float, float]]:
    """Return the stops as intervals (start, end), from the recorded speeds, or from the speeds of a preliminary fit.

    At a stop the vehicle is slow and stays near its mean position for the minimum duration. Slow intervals during
    which, together, it stays there are one stop.
    """
    inliers = recording.weights > 0
    times, positions = recording.times[inliers], recording.positions[inliers]
    if _spread(positions) <= standing.distance:
        return [(0.0, float(recording.times[-1]))]
    speeds = _speeds(recording, inliers)
    bound = SLOW * speeds.max() if standing.speed is None else standing.speed
    slow = np.concatenate([[False], speeds <= bound, [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    shortest = max(MIN_STOP, MIN_STEPS * recording.step)
    found: list[tuple[int, int]] = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        if found and _spread(positions[found[-1][0] : last + 1]) <= standing.distance:
            found[-1] = (found[-1][0], last)  # the speed between them is noise
        elif _spread(positions[first : last + 1]) <= standing.distance:
            found.append((first, last))
    return [(float(times[a]), float(times[b])) for a, b in found if times[b] - times[a] >= shortest]


def _spread(positions: Float[np.ndarray, "n 3"]) -> float:
    """Return the largest distance from the mean position."""
    return float(lengths(positions - positions.mean(axis=0)).max())


def _speeds(recording: Recording, inliers: np.ndarray) -> Float[np.ndarray, " n"]:
    if recording.velocities is not None:
        return lengths(recording.velocities[inliers])
    times, positions = recording.times[inliers], recording.positions[inliers]
    grid = read_knots(None, recording.times, recording.step, recording.units.time).knots
    samples = sample_system(design(grid, times), positions, recording.position_weights[inliers])
    states = solve(samples.plus(jerk_system(grid), SMOOTHING / recording.step))
    return lengths(predict(design(grid, times, 1), states))
