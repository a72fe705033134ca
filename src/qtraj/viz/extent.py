"""Determine which part of space a figure of paths shows; outliers of a recording do not extend it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

NEAR = 0.1
"""Recorded points count if they are at most this fraction of the largest extent outside the box of the paths."""


def box(points: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and largest coordinates of all finite points (..., d); zeros (3,) if there are none."""
    rows = np.concatenate([x.reshape(-1, x.shape[-1]) for x in points]) if points else np.zeros((0, 3))
    rows = rows[np.isfinite(rows).all(axis=1)]
    return (rows.min(axis=0), rows.max(axis=0)) if len(rows) else (np.zeros(3), np.zeros(3))


def beside(recorded: Float[np.ndarray, "n d"], paths: Sequence[np.ndarray]) -> Float[np.ndarray, "k d"]:
    """Return the recorded points that are in the box of the paths or near it."""
    low, high = box(paths)
    reach = NEAR * float((high - low).max())
    return recorded[((recorded >= low - reach) & (recorded <= high + reach)).all(axis=1)]
