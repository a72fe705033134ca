"""Heading, pitch and roll of upright frames."""

import numpy as np

STEEP = 1e-6
"""Least horizontal part of the forward axis: below it there is no heading, and no roll either."""


def heading_pitch_roll(axes: np.ndarray) -> np.ndarray:
    """Heading, pitch and roll (n, 3) [°] from direction cosines (n, 3, 3): rows forward, left, up; the world's z up.

    Heading from x towards y, without jumps by 360°; pitch with the nose up; roll with the left side up. NaN where an
    axis is missing, or where forward is straight up or down.
    """
    forward, left, up = np.moveaxis(axes, 1, 0)
    level = np.hypot(forward[:, 0], forward[:, 1]) > STEEP
    heading = np.where(level, np.arctan2(forward[:, 1], forward[:, 0]), np.nan)
    known = np.isfinite(heading)
    heading[known] = np.unwrap(heading[known])
    pitch = np.arctan2(forward[:, 2], np.hypot(forward[:, 0], forward[:, 1]))
    roll = np.where(level, np.arctan2(left[:, 2], up[:, 2]), np.nan)
    return np.degrees(np.stack([heading, pitch, roll], axis=1))
