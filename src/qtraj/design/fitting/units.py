"""Units of time and length taken from a recording, in which the constants of a fit are the same for all vehicles.

The unit of time is ten time steps of the recording, unless this is much shorter or much longer than the vehicle drives
almost straight. A fit in these units scales exactly with the recording.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

TURN = 0.11
"""Change of the mean velocity from one interval of almost straight motion to the next, relative to the mean speed."""

SHARE = 0.75
"""Quantile of the changes and of the speeds of a moving vehicle, so that it may drive straight most of the time."""

STEPS, MIN_STEPS = 10, 2
"""Usual and minimum unit of time in time steps."""

SHORTEST, LONGEST = 1 / 3, 1.25
"""Minimum and maximum unit of time, relative to the duration of almost straight motion."""

GROWTH = 1.5
"""Minimum growth of the change, when the intervals are doubled, of a vehicle that turns from sample to sample."""

PAIRS = 4096
"""Maximum number of changes that are computed for a time between samples."""


class Units(NamedTuple):
    """The units of time [s] and length [m] of a recording."""

    time: float
    length: float


def units(times: Float[np.ndarray, " n"], positions: Float[np.ndarray, "n 3"]) -> Units:
    """Return the units of a recording; the unit of length is covered in a unit of time at the upper quartile of speed.

    The mean velocity changes from one interval to the next for two reasons: noise, whose influence decreases with the
    length of the intervals, and the motion, whose influence increases. The motion is almost straight up to the length
    at which the change due to the motion exceeds `TURN`.
    """
    lags = [1]
    while 4 * lags[-1] < len(times) - 1:
        lags.append(2 * lags[-1])
    spans, changes, speeds = np.array([_change(times, positions, lag) for lag in lags]).T
    within = changes <= TURN
    time = STEPS * spans[0]
    if within.all():
        straight = spans[-1]
    elif (rising := np.flatnonzero(within[:-1] & ~within[1:])).size:
        k = rising[0]
        share = np.log(TURN / changes[k]) / np.log(changes[k + 1] / changes[k]) if changes[k] > 0 else 1.0
        straight = spans[k] * (spans[k + 1] / spans[k]) ** share
    elif len(lags) > 1 and changes[1] > GROWTH * changes[0]:  # the vehicle turns from sample to sample
        straight = spans[0] * TURN / changes[0]
    else:  # the noise conceals the motion
        straight = time
    time = max(float(np.clip(time, SHORTEST * straight, LONGEST * straight)), float(MIN_STEPS * spans[0]))
    speed = float(speeds[np.abs(spans - time).argmin()])
    return Units(time, speed * time or 1.0)


def _change(times: np.ndarray, positions: np.ndarray, lag: int) -> tuple[float, float, float]:
    """Return the time [s] between samples that are `lag` apart, the relative change of the velocity, and the speed."""
    last = len(times) - 1 - 2 * lag
    if last < 0:  # two samples
        span = float(times[-1] - times[0])
        return span, 0.0, float(np.linalg.norm(positions[-1] - positions[0])) / span
    starts = np.unique(np.linspace(0, last, min(last + 1, PAIRS)).astype(int))
    nodes = [starts + k * lag for k in range(3)]
    spans = np.diff([times[node] for node in nodes], axis=0)
    velocities = np.diff([_without_spikes(positions, node) for node in nodes], axis=0) / spans[..., None]
    moving = velocities.any(axis=(0, 2))  # not at rest, or held by a logger that is faster than its receiver
    if not moving.any():
        return float(np.median(spans)), 0.0, 0.0
    velocities = velocities[:, moving]
    speed = float(np.quantile(np.linalg.norm(velocities, axis=-1), SHARE))
    change = float(np.quantile(np.linalg.norm(velocities[1] - velocities[0], axis=-1), SHARE))
    return float(np.median(spans)), change / speed, speed


def _without_spikes(positions: Float[np.ndarray, "n 3"], at: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    """Return the medians of three consecutive positions, one of which may be an outlier."""
    near = np.clip(at + np.arange(-1, 2)[:, None], 0, len(positions) - 1)
    return np.median(positions[near], axis=0)
