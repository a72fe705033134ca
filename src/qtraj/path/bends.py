"""Find the bends of a recorded track: intervals in which the direction of travel turns to the left or to the right.

Steering corrections and noise cause small oscillations of the direction. Therefore a bend ends only when the direction
has turned back by a minimum angle. Maxima and minima of the direction then alternate, and each bend lies between two
successive extrema.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from qtraj.path.track import STANDSTILL, Track, directions, spread_radius, to_float64

ENDS = 0.05
"""Fraction of the turn that is removed at each end of a bend."""


class Bend(NamedTuple):
    """A time interval from `start` to `end` [s] in which a track turns by `turn` [rad], positive to the left."""

    start: float
    end: float
    turn: float


def bends(track: Track, min_turn: float, spacing: float, standstill: float = STANDSTILL) -> list[Bend]:
    """Find the bends with a turn of at least `min_turn` [rad], in order; consecutive bends have opposite directions.

    A track has no bends if its horizontal distance from its mean position is never more than `standstill` [m]. If no
    velocities were recorded, the directions are computed from horizontal chords of at least `spacing` [m].
    """
    if spread_radius(track) <= standstill:
        return []
    times, direction = _travel(track, spacing)
    turning = _turning_points(direction, min_turn)
    return [_bend(times[i : j + 1], direction[i : j + 1]) for i, j in pairwise(turning)]


def chord_length(track: Track, spacing: float) -> float:
    """Return the horizontal length [m] of the track along chords of at least `spacing` [m]."""
    positions = to_float64(track.positions)[:, :2]
    return float(np.hypot(*np.diff(positions[_marks(positions, spacing)], axis=0).T).sum())


def _travel(track: Track, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the times [s] and the unwrapped directions of travel [rad] while the vehicle moves.

    There is one direction for each recorded velocity. Without velocities, there is one direction for each chord of at
    least `spacing` [m]; its time is the middle of the chord's time interval.
    """
    times = to_float64(track.times)
    if track.velocities is not None:
        moving, direction = directions(to_float64(track.velocities))
        return times[moving], direction
    marks = _marks(to_float64(track.positions)[:, :2], spacing)
    chords = np.diff(to_float64(track.positions)[marks], axis=0)
    middles = (times[marks[1:]] + times[marks[:-1]]) / 2
    moving, direction = directions(chords)
    return middles[moving], direction


def _marks(positions: np.ndarray, spacing: float) -> np.ndarray:
    """Select samples of `positions` (n, 2) [m], and return their indices.

    Each selected sample is at least `spacing` [m] from the previously selected sample.
    """
    marks = [0]
    for k, position in enumerate(positions):
        if np.hypot(*(position - positions[marks[-1]])) >= spacing:
            marks.append(k)
    return np.array(marks)


def _turning_points(direction: np.ndarray, min_turn: float) -> list[int]:
    """Return the indices of the extrema of `direction` (n,) [rad], in order.

    Successive extrema differ by at least `min_turn` [rad]. If there is no bend, the list is empty.
    """
    points: list[int] = []
    low = high = sense = 0
    for k, angle in enumerate(direction):
        low, high = (k if angle < direction[low] else low), (k if angle > direction[high] else high)
        rises, falls = angle - direction[low] >= min_turn, direction[high] - angle >= min_turn
        if rises and sense <= 0:
            points.append(low)
            high, sense = k, 1
        elif falls and sense >= 0:
            points.append(high)
            low, sense = k, -1
    return [*points, high if sense > 0 else low] if sense else []


def _bend(times: np.ndarray, direction: np.ndarray) -> Bend:
    """Create the bend between two turning points from the `times` (n,) [s] and directions (n,) [rad] between them."""
    turn = direction[-1] - direction[0]
    part = (direction - direction[0]) / turn
    start, end = np.flatnonzero(part <= ENDS)[-1], np.flatnonzero(part >= 1 - ENDS)[0]
    start = min(start, end - 1)
    return Bend(float(times[start]), float(times[end]), float(turn))
