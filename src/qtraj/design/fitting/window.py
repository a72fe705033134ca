"""Checks that a recorded window contains one turn that can be fitted, and measures its radius."""

from typing import NamedTuple

import numpy as np

from qtraj.path.bends import Bend, bends, chord_length
from qtraj.path.track import STANDSTILL, Track, spread_radius, to_float64, travel_length, travel_turn

POSITION_SIGMA, VELOCITY_SIGMA = 0.005, 0.08
"""Default noise [m], [m/s]: the residual of cubics over 1 s of a car's smoothed recording (Boreas)."""

MIN_TURN = float(np.radians(10.0))
"""[rad] Minimum turn of a window; a smaller turn does not determine the axis."""

MIN_LENGTH = 200.0
"""Minimum length of a window in standard deviations of a position.

At this length a turn of `MIN_TURN` deviates from its chord by four standard deviations.
"""

MIN_SAMPLES = 8
"""Minimum number of samples. Each has two coordinates in the plane, for up to ten unknowns, so about as many are left.
"""

WANDER = 1.0
"""[m] Maximum drift of the positions of a parked vehicle, if its velocities show that it stands still."""

WINDOW = "with track.window(t0, t1), in a scenario with the key window"
"""How to choose a window."""

SPACING = 2 * MIN_LENGTH
"""Length in standard deviations of the chords that give the direction of travel if no velocities are recorded."""


class Turn(NamedTuple):
    """The radii of a window [m]: its length over the net turn (`radius`), or over all turning (`total_radius`)."""

    radius: float
    total_radius: float


def measure_turn(track: Track, sigma: float, velocity_sigma: float = VELOCITY_SIGMA) -> Turn:
    """The turn of a window; `sigma` [m] and `velocity_sigma` [m/s] are the standard deviations of the recording.

    **Raises:** ValueError for too few samples, for a vehicle that stands still, and for a window that is too short, has
    bends of opposite sense, or is nearly straight.
    """
    if not isinstance(track, Track):
        raise ValueError(f"fit needs a Track, as read_track returns, but a {type(track).__name__} was given")
    count = track.times.shape[0]
    if count < MIN_SAMPLES:
        raise ValueError(f"a fit needs at least {MIN_SAMPLES} samples, but the window has {count}: widen it")
    length = _moving_length(track, sigma, velocity_sigma)
    standstill_radius = _standstill_radius(sigma)
    turn = travel_turn(track, standstill_radius)
    single_bends = bends(track, MIN_TURN, SPACING * sigma, standstill_radius)
    if abs(turn) < MIN_TURN:
        if len(single_bends) > 1:
            raise ValueError(_opposite_bends_message(turn, chord_length(track, SPACING * sigma), single_bends))
        raise ValueError(_straight_message(turn, chord_length(track, SPACING * sigma)))
    return Turn(length / abs(turn), length / max(abs(turn), sum(abs(bend.turn) for bend in single_bends)))


def _moving_length(track: Track, sigma: float, velocity_sigma: float) -> float:
    """The horizontal length of a window [m]; raises a ValueError if it is too short."""
    standstill_radius, min_length = _standstill_radius(sigma), MIN_LENGTH * sigma
    if spread_radius(track) <= standstill_radius:
        climb = float(np.ptp(to_float64(track.positions)[:, 2]))
        if climb > 2 * standstill_radius:
            raise ValueError(
                f"the window is a vertical climb: the height changes by {climb:.3g} m, but all positions are within "
                f"{standstill_radius:g} m of a vertical line, so there is no horizontal direction of travel. "
                f"Choose a window in which the vehicle turns, {WINDOW}."
            )
        raise ValueError(
            "the vehicle stands still in this window: all positions are within "
            f"{standstill_radius:g} m of their centre, so there is no direction of travel and no turn. Choose a window "
            f"in which it moves, {WINDOW}."
        )
    speed = _rms_speed(track)
    if speed is not None and speed <= velocity_sigma and spread_radius(track) <= WANDER:
        raise ValueError(
            f"the vehicle stands still in this window: its recorded speed, {speed:.2g} m/s, does not exceed "
            f"velocity_sigma = {velocity_sigma:g} m/s, and its positions drift by less than {WANDER:g} m. Choose a "
            f"window in which it moves, {WINDOW}, or pass a smaller velocity_sigma for a slow vehicle."
        )
    length = travel_length(track)
    if length < min_length:
        raise ValueError(
            f"the window is too short: the vehicle travels {length:.3g} m in it, but at least {min_length:.3g} m, "
            f"{MIN_LENGTH:.0f} times position_sigma = {sigma:g} m, are needed to distinguish a turn from noise. Widen "
            f"the window, {WINDOW}, or pass a smaller position_sigma if the positions are more accurate."
        )
    return length


def _rms_speed(track: Track) -> float | None:
    """The root mean square of the recorded speed [m/s]; None without velocities."""
    if track.velocities is None:
        return None
    return float(np.sqrt(np.mean(np.sum(to_float64(track.velocities) ** 2, axis=1))))


def _standstill_radius(sigma: float) -> float:
    """The radius of a track that stands still [m]: 20 standard deviations of a position, but at most 0.1 m."""
    return min(STANDSTILL, MIN_LENGTH * sigma / 10)


def _opposite_bends_message(turn: float, length: float, single_bends: list[Bend]) -> str:
    sharpest = max(single_bends, key=lambda bend: abs(bend.turn))
    span = f"{sharpest.start:.2f} to {sharpest.end:.2f} s"
    return (
        f"the window contains {len(single_bends)} bends in opposite directions: over {length:.4g} m the direction "
        f"of travel turns by {np.degrees(turn):.2f}° from start to end, but a spiral-helix follows only one bend. "
        "A reversal of the driving direction also counts as a bend. "
        f"Choose a window around one bend, {WINDOW}; the largest, from about {span}, turns by "
        f"{np.degrees(sharpest.turn):.1f}°."
    )


def _straight_message(turn: float, length: float) -> str:
    return (
        f"the window is nearly straight: over {length:.4g} m the direction of travel turns by {np.degrees(turn):.2f}° "
        f"from start to end, but at least {np.degrees(MIN_TURN):.0f}° are needed to determine the axis of a "
        f"spiral-helix. Choose a window around one bend, {WINDOW}."
    )
