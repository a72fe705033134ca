"""Detect the stops of a recorded drive."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.motion import Motion
from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_jumps import lengths
from qtraj.design.fitting.route_knots import read_knots
from qtraj.design.fitting.route_outliers import SMOOTHING
from qtraj.design.fitting.route_standstill import samples_of, standstills
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve
from qtraj.path.track import STANDSTILL

SLOW = 0.005
"""Default of the maximum speed at a stop, relative to the largest speed of the recording."""

MIN_STOP, MIN_STEPS = 1.0, 4
"""Minimum duration of a stop, in units of time and in time steps of the recording; the longer one applies."""


NOISY_SPEED, NOISY_DISTANCE = 4.0, 6.0
"""Minimum of the speed at a stop in standard deviations of the fitted velocity, and of the distance from the mean
position in standard deviations of the positions, unless the user has given them."""


NOISIEST = 4.0
"""Largest ratio of the distance that follows from the noise to the default one. With more noise, the spread does not
show whether the vehicle stands or creeps, and a stop that does not exist would be worse than one that is missed: so a
stop needs a test of its motion, too."""

CREEPING = 0.015
"""Speed of a creeping vehicle that this test would notice, relative to the largest speed of the recording."""


class Standing(NamedTuple):
    """What counts as a stop: the speed and the distance from the mean position, in own units; None for the defaults."""

    speed: float | None
    distance: float | None


def find_stops(recording: Recording, standing: Standing) -> list[tuple[float, float]]:
    """Return the stops as intervals (start, end), from the recorded speeds, or from the speeds of a preliminary fit.

    At a stop the vehicle is slow and stays near its mean position for the minimum duration. Slow intervals during
    which, together, it stays there are one stop.
    """
    inliers = recording.weights > 0
    distance = _distance(recording, standing)
    if _spread(recording.positions[inliers]) <= distance:
        return [(0.0, float(recording.times[-1]))]
    speeds = _speeds(recording, inliers)
    bound = SLOW * speeds.max() if standing.speed is None else standing.speed
    return _intervals(recording, speeds, bound, distance)


def stops_in_noise(recording: Recording, standing: Standing, motion: Motion) -> list[tuple[float, float]] | None:
    """Return the stops of a recording whose noise exceeds the default speed or distance at a stop, otherwise None.

    Only a fit whose smoothing is that of the recording tells the noise and the motion apart.
    """
    inliers = recording.weights > 0
    speeds, noise = lengths(motion.at(recording.times[inliers], 1)), motion.noise
    bound, distance = SLOW * float(speeds.max()), _distance(recording, standing)
    noisy_speed = bound if standing.speed is not None else NOISY_SPEED * noise.velocity
    noisy_distance = distance if standing.distance is not None else NOISY_DISTANCE * noise.position
    if noisy_speed <= bound and noisy_distance <= distance:
        return None
    creeping = CREEPING * float(speeds.max()) if standing.speed is None else standing.speed
    if standing.speed is None:
        bound = max(bound, noisy_speed)
    if noisy_distance > NOISIEST * distance:
        found = _intervals(recording, speeds, bound, noisy_distance)
        tested = standstills(samples_of(recording, noise.position), found, creeping, _shortest(recording))
        return _until_ends(recording, tested, noisy_distance) or None
    distance = max(distance, noisy_distance)
    if _spread(recording.positions[inliers]) <= distance:
        return [(0.0, float(recording.times[-1]))]
    return _until_ends(recording, _intervals(recording, speeds, bound, distance), distance)


def _until_ends(recording: Recording, stops: list[tuple[float, float]], distance: float) -> list[tuple[float, float]]:
    """Extend stops to an end of the recording that is near, where the velocity of a fit is much less accurate."""
    inliers = recording.weights > 0
    times, positions = recording.times[inliers], recording.positions[inliers]
    last, near = float(recording.times[-1]), _shortest(recording)
    found = []
    for a, b in stops:
        start, end = 0.0 if a < near else a, last if last - b < near else b
        spread = _spread(positions[(times >= start) & (times <= end)])
        found.append((start, end) if spread <= distance else (a, b))
    return found


def _distance(recording: Recording, standing: Standing) -> float:
    return STANDSTILL / recording.units.length if standing.distance is None else standing.distance


def _shortest(recording: Recording) -> float:
    return max(MIN_STOP, MIN_STEPS * recording.step)


def _intervals(
    recording: Recording, speeds: Float[np.ndarray, " n"], bound: float, distance: float
) -> list[tuple[float, float]]:
    """Return the stops for the speeds at the inliers, and for bounds on the speed and on the distance."""
    inliers = recording.weights > 0
    times, positions = recording.times[inliers], recording.positions[inliers]
    slow = np.concatenate([[False], speeds <= bound, [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    found: list[tuple[int, int]] = []
    for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
        if found and _spread(positions[found[-1][0] : last + 1]) <= distance:
            found[-1] = (found[-1][0], last)  # the speed between them is noise
        elif _spread(positions[first : last + 1]) <= distance:
            found.append((first, last))
    return [(float(times[a]), float(times[b])) for a, b in found if times[b] - times[a] >= _shortest(recording)]


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
