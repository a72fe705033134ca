"""Compute the colours of a map of a path from its curvature, for figures and reports."""

from typing import NamedTuple

import numpy as np
import xarray

COLOURED = 0.95
"""Quantile of the curvature at which the colour scale ends, because the curvature can be very large near stops."""

SLOW = 0.05
"""Samples slower than this fraction of the largest speed count as stops.

Stops do not affect the colour scale, and are drawn in the colour of zero curvature.
"""


class MapColours(NamedTuple):
    """Curvatures (n,) [1/m] that determine the colours of samples, and the end [1/m] of the colour scale."""

    values: np.ndarray
    top: float


def map_colours(path: xarray.Dataset) -> MapColours:
    """Compute the colours of one path from its curvature and, if the dataset contains it, its speed."""
    curvature = np.abs(path["curvature"].values.astype(float))
    moving = np.isfinite(curvature)
    if "speed" in path:
        speed = path["speed"].values
        moving &= speed > SLOW * np.nanmax(speed, initial=0.0)
    top = float(np.quantile(curvature[moving], COLOURED)) if moving.any() else 1.0
    return MapColours(np.where(moving, curvature, 0.0), top or 1.0)
