"""Check that a recorded window contains one turn that can be fitted, and measure its radius."""

from typing import NamedTuple

import numpy as np

from qtraj.path.bends import Bend, bends, chord_length
from qtraj.path.track import Track, spread_radius, to_float64, travel_length, travel_turn

POSITION_SIGMA, VELOCITY_SIGMA = 0.005, 0.08
"""Default standard deviations of positions [m] and velocities [m/s].

These values are the residuals of cubics that were fitted to intervals of 1 s of a car's smoothed recording (Boreas).
"""

MIN_TURN = float(np.radians(10.0))
"""[rad] Minimum turn of a window; a smaller turn does not determine the axis."""

MIN_LENGTH = 200.0
"""Minimum length of a window, in standard deviations of a position.

At this length a turn of `MIN_TURN` deviates from its chord by about four standard deviations.
"""

MIN_SAMPLES = 8
"""Minimum number of samples: their 16 horizontal coordinates determine up to ten unknowns and leave some redundancy."""

STILL, WANDER = 20.0, 200.0
"""Radius of the positions of a vehicle at rest, in standard deviations of a position; the second number applies if its
recorded velocities are almost zero."""

WINDOW = "(track.window(t0, t1) in Python, the key window in a scenario)"
"""Advice on how to choose a window."""

SPACING = 2 * MIN_LENGTH
"""Length of the chords, in position sigmas, that determine the direction of travel if no velocities are recorded."""


class Turn(NamedTuple):
    """The radii of a window [m].

    `radius` is the length of the window divided by the magnitude of the net turn. `total_radius` is this length divided
    by the magnitude of the net turn or the sum of the magnitudes of the turns of all bends, whichever is larger.
    """

    radius: float
    total_radius: float


def measure_turn(track: Track, sigma: float, velocity_sigma: float = VELOCITY_SIGMA) -> Turn:
    """Measure the radii of a window; `sigma` [m] and `velocity_sigma` [m/s] are standard deviations of the recording.

    **Raises:** ValueError for an argument other than a `Track`, for too few samples, for a vehicle that stands still,
    and for a window that is too short, has bends in opposite directions that cancel each other, or is nearly straight.
    """
    if not isinstance(track, Track):
        raise ValueError(f"fit needs a Track, as returned by read_track, but a {type(track).__name__} was given")
    count = track.times.shape[0]
    if count < MIN_SAMPLES:
        raise ValueError(f"a fit needs at least {MIN_SAMPLES} samples, but the window has {count}: widen the window")
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
    """Return the horizontal distance travelled in a window [m].

    **Raises:** ValueError for a distance that is too short, and for a vehicle that stands still or moves vertically.
    """
    standstill_radius, min_length = _standstill_radius(sigma), MIN_LENGTH * sigma
    if spread_radius(track) <= standstill_radius:
        climb = float(np.ptp(to_float64(track.positions)[:, 2]))
        if climb > 2 * standstill_radius:
            raise ValueError(
                f"the vehicle moves vertically in this window: the height changes by {climb:.3g} m, but all positions "
                f"are within {standstill_radius:g} m of a vertical line, so there is no horizontal direction. "
                f"Choose a window in which the vehicle turns {WINDOW}."
            )
        raise ValueError(
            "the vehicle stands still in this window: all positions are within "
            f"{standstill_radius:g} m of their centre, so there is no direction of travel and no turn. Choose a window "
            f"in which it moves {WINDOW}."
        )
    speed = _rms_speed(track)
    if speed is not None and speed <= velocity_sigma and spread_radius(track) <= WANDER * sigma:
        raise ValueError(
            f"the vehicle stands still in this window: its recorded speed, {speed:.2g} m/s, does not exceed "
            f"velocity_sigma = {velocity_sigma:g} m/s, and its positions drift by less than {WANDER * sigma:g} m. "
            f"Choose a window in which it moves {WINDOW}, or pass a smaller velocity_sigma for a slow vehicle."
        )
    length = travel_length(track)
    if length < min_length:
        raise ValueError(
            f"the window is too short: the vehicle travels {length:.3g} m in it, but at least {min_length:.3g} m, "
            f"{MIN_LENGTH:.0f} times position_sigma = {sigma:g} m, are needed to distinguish a turn from noise. Widen "
            f"the window {WINDOW}, or pass a smaller position_sigma if the positions are more accurate."
        )
    return length


def _rms_speed(track: Track) -> float | None:
    """Return the RMS recorded speed [m/s], or None if no velocities are recorded."""
    if track.velocities is None:
        return None
    return float(np.sqrt(np.mean(np.sum(to_float64(track.velocities) ** 2, axis=1))))


def _standstill_radius(sigma: float) -> float:
    """Return the radius [m] within which a vehicle counts as at rest."""
    return STILL * sigma


def _opposite_bends_message(turn: float, length: float, single_bends: list[Bend]) -> str:
    sharpest = max(single_bends, key=lambda bend: abs(bend.turn))
    span = f"{sharpest.start:.2f} to {sharpest.end:.2f} s"
    return (
        f"the window contains {len(single_bends)} bends in opposite directions: over {length:.4g} m the direction "
        f"of travel turns by {np.degrees(turn):.2f}° from start to end, but a spiral-helix follows only one bend. "
        "A reversal of the driving direction also counts as a bend. "
        f"Choose a window around one bend {WINDOW}; the largest bend, from about {span}, turns by "
        f"{np.degrees(sharpest.turn):.1f}°."
    )


def _straight_message(turn: float, length: float) -> str:
    return (
        f"the window is nearly straight: over {length:.4g} m the direction of travel turns by {np.degrees(turn):.2f}° "
        f"from start to end, but at least {np.degrees(MIN_TURN):.0f}° are needed to determine the axis of a "
        f"spiral-helix. Choose a window around one bend {WINDOW}."
    )
