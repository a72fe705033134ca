"""Checks that a recorded window contains one turn that can be fitted, and measures its radius."""

from typing import NamedTuple

import numpy as np

from qtraj.path.bends import Bend, bends
from qtraj.path.track import STANDSTILL, Track, spread_radius, travel_length, travel_turn

POSITION_SIGMA, VELOCITY_SIGMA = 0.005, 0.08
"""Default noise [m], [m/s]: the residual of cubics over 1 s of a car's smoothed recording (Boreas)."""

MIN_TURN = float(np.radians(10.0))
"""A window that turns by less than this does not determine the axis [rad]."""

MIN_LENGTH = 200.0
"""Minimum length of a window in standard deviations of a position.

At this length a turn of `MIN_TURN` deviates from its chord by four of them.
"""

MIN_SAMPLES = 8
"""Enough for up to ten unknowns in the plane from two coordinates per sample, with about as many left over."""

SPACING = 2 * MIN_LENGTH
"""Length of the chords that give the direction of travel without recorded velocities, in standard deviations."""


class Turn(NamedTuple):
    """The turn of a window: `radius` is its length over the net turn [m], `total_radius` that over all turning [m]."""

    radius: float
    total_radius: float


def measure_turn(track: Track, sigma: float) -> Turn:
    """The turn of a window whose positions have the standard deviation `sigma` [m].

    **Raises:** ValueError for too few samples, for a vehicle that stands still, and for a window that is too short, has
    bends of opposite sense, or is nearly straight.
    """
    if not isinstance(track, Track):
        raise ValueError(f"fit needs a Track, as read_track returns, but a {type(track).__name__} was given")
    count = track.times.shape[0]
    if count < MIN_SAMPLES:
        raise ValueError(f"a fit needs at least {MIN_SAMPLES} samples, but the window has {count}: widen it")
    length = _moving_length(track, sigma)
    standstill_radius = _standstill_radius(sigma)
    turn = travel_turn(track, standstill_radius)
    single_bends = bends(track, MIN_TURN, SPACING * sigma, standstill_radius)
    if abs(turn) < MIN_TURN:
        if len(single_bends) > 1:
            raise ValueError(_opposite_bends_message(turn, length, single_bends))
        raise ValueError(_straight_message(turn, length))
    return Turn(length / abs(turn), length / max(abs(turn), sum(abs(bend.turn) for bend in single_bends)))


def _moving_length(track: Track, sigma: float) -> float:
    """The length of a window [m], checked to be long enough."""
    standstill_radius, min_length = _standstill_radius(sigma), MIN_LENGTH * sigma
    if spread_radius(track) <= standstill_radius:
        raise ValueError(
            "the vehicle stands still in this window: all positions are within "
            f"{standstill_radius:g} m of their centre, so there is no direction of travel and no turn. Choose a window "
            "in which it drives, with track.window(t0, t1)."
        )
    length = travel_length(track)
    if length < min_length:
        raise ValueError(
            f"the window is too short: the vehicle travels {length:.3g} m in it, but at least {min_length:.3g} m, "
            f"{MIN_LENGTH:.0f} times position_sigma = {sigma:g} m, are needed to distinguish a turn from noise. Widen "
            "the window with track.window(t0, t1), or pass a smaller position_sigma if the positions are more accurate."
        )
    return length


def _standstill_radius(sigma: float) -> float:
    """The radius of a track that stands still [m]: 20 standard deviations of a position, but at most 0.1 m."""
    return min(STANDSTILL, MIN_LENGTH * sigma / 10)


def _opposite_bends_message(turn: float, length: float, single_bends: list[Bend]) -> str:
    sharpest = max(single_bends, key=lambda bend: abs(bend.turn))
    span = f"{sharpest.start:.2f} to {sharpest.end:.2f} s"
    return (
        f"the window holds {len(single_bends)} bends that turn against each other: over {length:.4g} m the direction "
        f"of travel turns by {np.degrees(turn):.2f}° from start to end, but a spiral-helix follows one bend only. "
        f"Choose a window around one bend with track.window(t0, t1); the largest, from about {span}, turns by "
        f"{np.degrees(sharpest.turn):.1f}°."
    )


def _straight_message(turn: float, length: float) -> str:
    return (
        f"the window is nearly straight: over {length:.4g} m the direction of travel turns by {np.degrees(turn):.2f}° "
        f"from start to end, but at least {np.degrees(MIN_TURN):.0f}° are needed to determine the axis of a "
        "spiral-helix. Choose a window around one bend with track.window(t0, t1)."
    )
