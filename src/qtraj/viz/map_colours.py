"""The colours of a map of a path, by curvature: the same in figures and in reports."""

from typing import NamedTuple

import numpy as np
import xarray

COLOURED = 0.95
"""Quantile of the curvature at which the colour scale ends, because curvature is infinite at stops."""

SLOW = 0.05
"""Samples below this part of the largest speed count as a stop: they have colour 0 and do not change the scale."""


class MapColours(NamedTuple):
    """The curvature to colour at each sample (n,) [1/m], and the end of the colour scale, which starts at 0."""

    values: np.ndarray
    top: float


def map_colours(path: xarray.Dataset) -> MapColours:
    """The colours of one path, from its curvature and, if the dataset contains it, its speed."""
    curvature = np.abs(path["curvature"].values.astype(float))
    moving = np.isfinite(curvature)
    if "speed" in path:
        speed = path["speed"].values
        moving &= speed > SLOW * np.nanmax(speed, initial=0.0)
    top = float(np.quantile(curvature[moving], COLOURED)) if moving.any() else 1.0
    return MapColours(np.where(moving, curvature, 0.0), top or 1.0)
