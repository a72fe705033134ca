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


STEPS = 64
"""The number of colours of lines: with fewer lines, figures are drawn faster and are smaller."""


class MapColours(NamedTuple):
    """Curvatures (n,) [1/m] that determine the colours of samples, and the end [1/m] of the colour scale."""

    values: np.ndarray
    top: float

    def lines(self, points: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Return lines through consecutive `points` (n, 2), each of one colour, and the curvatures of their colours.

        A line has the colour of the sample at its start.
        """
        step = np.minimum(STEPS * (self.values[:-1] / self.top), STEPS - 1).astype(int)
        starts = np.append(0, np.flatnonzero(np.diff(step)) + 1)
        ends = np.append(starts[1:], len(step))
        lines = [points[start : end + 1] for start, end in zip(starts, ends, strict=True)]
        return lines, (step[starts] + 0.5) * self.top / STEPS


def map_colours(path: xarray.Dataset) -> MapColours:
    """Compute the colours of one path from its curvature and, if the dataset contains it, its speed."""
    curvature = np.abs(path["curvature"].values.astype(float))
    moving = np.isfinite(curvature)
    if "speed" in path:
        speed = path["speed"].values
        moving &= speed > SLOW * np.nanmax(speed, initial=0.0)
    top = float(np.quantile(curvature[moving], COLOURED)) if moving.any() else 1.0
    return MapColours(np.where(moving, curvature, 0.0), top or 1.0)
