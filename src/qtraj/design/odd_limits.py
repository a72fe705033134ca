"""Find limits that are probably in another unit than expected, by a comparison with a recording."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from qtraj.foundation.size_text import length_text
from qtraj.path.track import Track

TIGHT = 100.0
"""Minimum ratio of the extent of a recording to a radius that is odd."""

TOO_FAST = (1.8, 9.0)
"""Range of the ratio of a limit on the speed to the largest recorded speed in which the limit may be in km/h."""

TURNING = 10.0
"""Limit on an angular rate [rad/s] above which it may be in degrees."""


def odd_limits(limits: Mapping[str, Any], track: Track) -> tuple[str, ...]:
    """Return a text about each limit that is odd for a recording, with the value to write instead.

    Limits with two sides, and limits that change along the way, are not compared.
    """
    one_sided = ((name, float(value)) for name, value in limits.items() if isinstance(value, int | float))
    return tuple(text for name, value in one_sided for text in _oddity(name, value, track))


def odd_speeds(column: str, values: np.ndarray, track: Track) -> tuple[str, ...]:
    """Return a text about a column of speed limits [m/s] that are probably in km/h."""
    largest = float(np.nanmax(values, initial=0.0))
    if not (largest > 20 and TOO_FAST[0] < largest / _largest_speed(track) < TOO_FAST[1]):
        return ()
    return (
        f"the speed limits in the column {column!r} are up to {largest:g} m/s, which is {3.6 * largest:.4g} km/h: if "
        "they are in km/h, write speed = {column = …, unit = 'km/h'}, or --limit speed=column:NAME:km/h",
    )


def _oddity(name: str, value: float, track: Track) -> Iterator[str]:
    positions = np.asarray(track.positions)
    extent = float(np.ptp(positions, axis=0).max())
    if name == "curvature" and value > 1 and extent * value > TIGHT:
        yield (
            f"the limit curvature = {value:g} is a radius of {length_text(1 / value)}: if {value:g} is a radius in m, "
            f"write curvature = {1 / value:.4g}"
        )
    if name == "slope" and value > 1:
        yield f"the limit slope = {value:g} is {100 * value:g} %: for {value:g} %, write slope = {value / 100:g}"
    if name in ("yaw_rate", "angular_rate") and value > TURNING:
        yield (
            f"the limit {name} = {value:g} is in rad/s: if {value:g} is in degrees per second, write {name} = "
            f"{math.radians(value):.4g}"
        )
    if name == "speed" and value > 20 and TOO_FAST[0] < value / _largest_speed(track) < TOO_FAST[1]:
        yield (
            f"the limit speed = {value:g} is in m/s, which is {3.6 * value:.4g} km/h: if {value:g} is in km/h, write "
            f"speed = {value / 3.6:.4g}"
        )


def _largest_speed(track: Track) -> float:
    """Return the 99th percentile of the recorded speeds, or of the speeds between samples."""
    if track.velocities is not None:
        speeds = np.linalg.norm(np.asarray(track.velocities), axis=1)
    else:
        speeds = np.linalg.norm(np.diff(np.asarray(track.positions), axis=0), axis=1) / np.diff(np.asarray(track.times))
    return float(np.quantile(speeds, 0.99)) or math.inf
