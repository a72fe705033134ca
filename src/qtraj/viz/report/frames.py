"""Compute body axes from quaternions, for drawing."""

import numpy as np


def cosines(quaternions: np.ndarray) -> np.ndarray:
    """Return the direction cosines (n, 3, 3) of quaternions (n, 4); row k is body axis k in inertial components.

    The quaternions need not be normalised. The result is NaN if a quaternion is zero or not finite.
    """
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    w, x, y, z = np.where(usable, quaternions, np.nan).T / np.where(usable, length, 1.0).T
    return np.stack(
        [
            np.stack([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1),
            np.stack([2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)], axis=1),
            np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=1),
        ],
        axis=1,
    )
