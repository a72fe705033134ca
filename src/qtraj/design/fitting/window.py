"""Whether a recorded window holds a turn that can be fitted, and how large that is."""

from typing import NamedTuple

import numpy as np

from qtraj.path.bends import Bend, bends
from qtraj.path.track import STANDSTILL, Track, spread_radius, travel_length, travel_turn

POSITION_SIGMA, VELOCITY_SIGMA = 0.005, 0.08
"""[m], [m/s] What cubics over 1 s leave of a car's smoothed recording (Boreas): the default noise."""

LEAST_TURN = float(np.radians(10.0))
"""A window that turns by less than this does not tell where its axis is [rad]."""

LEAST_LENGTH = 200.0
"""A window shorter than this, in standard deviations of a position, is refused: there the least turn leaves a chord by
four of them."""

FEWEST_SAMPLES = 8
"""Up to ten unknowns in the plane, from two coordinates of each sample, and as many again for a residual."""

SPACING = 2 * LEAST_LENGTH
"""Chords that tell directions of travel, where no velocities are recorded, in standard deviations of a position."""


class Turn(NamedTuple):
    """The turn of a window: `radius` [m], its length over its net turn; `bent` [m], its length over all it turns."""

    radius: float
    bent: float


def turn_of(track: Track, sigma: float) -> Turn:
    """How large the turn of a window is, whose positions have the standard deviation `sigma` [m].

    **Raises:** ValueError for too few samples, a vehicle that stands, a window that is too short, one whose bends turn
    against each other, or one that is nearly straight.
    """
    if not isinstance(track, Track):
        raise ValueError(f"fit needs a Track, as read_track gives, but a {type(track).__name__} was given")
    count = track.times.shape[0]
    if count < FEWEST_SAMPLES:
        raise ValueError(f"a fit needs at least {FEWEST_SAMPLES} samples, but the window holds {count}: widen it")
    length = _moving_length(track, sigma)
    standstill = _standstill(sigma)
    turn, found = travel_turn(track, standstill), bends(track, LEAST_TURN, SPACING * sigma, standstill)
    if abs(turn) < LEAST_TURN:
        raise ValueError(_winding(turn, length, found) if len(found) > 1 else _straight(turn, length))
    return Turn(length / abs(turn), length / max(abs(turn), sum(abs(bend.turn) for bend in found)))


def _moving_length(track: Track, sigma: float) -> float:
    """The length of a window [m] in which the vehicle moves far enough."""
    within, least = _standstill(sigma), LEAST_LENGTH * sigma
    if spread_radius(track) <= within:
        raise ValueError(
            f"the vehicle stands still in this window: all positions lie within {within:g} m of their middle, so there "
            "is no direction of travel and no turn. Choose a window in which it drives, with track.window(t0, t1)."
        )
    length = travel_length(track)
    if length < least:
        raise ValueError(
            f"the window is too short: the vehicle travels {length:.3g} m in it, but at least {least:.3g} m, "
            f"{LEAST_LENGTH:.0f} times position_sigma = {sigma:g} m, are needed to tell a turn from noise. Widen the "
            "window, with track.window(t0, t1); where the positions are more accurate, pass their position_sigma."
        )
    return length


def _standstill(sigma: float) -> float:
    """Within which distance of its middle a track stands [m]: 20 standard deviations of a position, 0.1 m at most."""
    return min(STANDSTILL, LEAST_LENGTH * sigma / 10)


def _winding(turn: float, length: float, found: list[Bend]) -> str:
    sharpest = max(found, key=lambda bend: abs(bend.turn))
    where = f"{sharpest.start:.2f} to {sharpest.end:.2f} s"
    return (
        f"the window holds {len(found)} bends that turn against each other: over {length:.4g} m the direction of "
        f"travel turns by {np.degrees(turn):.2f}° from start to end, but a spiral-helix follows one bend only. Choose "
        f"a window around one, with track.window(t0, t1); the largest, from about {where}, turns by "
        f"{np.degrees(sharpest.turn):.1f}°."
    )


def _straight(turn: float, length: float) -> str:
    return (
        f"the window is nearly straight: over {length:.4g} m the direction of travel turns by {np.degrees(turn):.2f}° "
        f"from start to end, but at least {np.degrees(LEAST_TURN):.0f}° are needed to tell where the axis of a "
        "spiral-helix is. Choose a window around one bend, with track.window(t0, t1)."
    )
