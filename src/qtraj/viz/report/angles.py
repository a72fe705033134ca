"""Compute heading, pitch and roll of upright frames."""

import numpy as np

MIN_HORIZONTAL = 1e-6
"""Length of the horizontal component of the forward axis below which heading and roll are not defined."""


def heading_pitch_roll(axes: np.ndarray) -> np.ndarray:
    """Return heading, pitch and roll (n, 3) [°] from direction cosines (n, 3, 3) with rows forward, left, up.

    World z is up. Heading is measured from x towards y, without jumps by 360°. Pitch is positive if the nose is up, and
    roll is positive if the left side is up. All are NaN if an axis is NaN; heading and roll are NaN if the forward axis
    is vertical.
    """
    forward, left, up = np.moveaxis(axes, 1, 0)
    level = np.hypot(forward[:, 0], forward[:, 1]) > MIN_HORIZONTAL
    heading = np.where(level, np.arctan2(forward[:, 1], forward[:, 0]), np.nan)
    finite = np.isfinite(heading)
    heading[finite] = np.unwrap(heading[finite])
    pitch = np.arctan2(forward[:, 2], np.hypot(forward[:, 0], forward[:, 1]))
    roll = np.where(level, np.arctan2(left[:, 2], up[:, 2]), np.nan)
    return np.degrees(np.stack([heading, pitch, roll], axis=1))
