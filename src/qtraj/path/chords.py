"""Bound the difference between the distance along a path and its chord in intervals of the parameter."""

import numpy as np
from jaxtyping import Float

from qtraj.path.distances import Distances
from qtraj.path.pace_bounds import pace_bounds

SAMPLES, RESERVE = 9, 1.25
"""On a path that is not polynomial, the number of points in an interval at which the distance is compared with its
chord, and the factor on the largest difference."""


def chord_gaps(
    on: Distances, low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Return the largest difference [m] between the distance and its chord in intervals; infinite at a joint.

    It is at most (high − low)²/8 times the largest derivative of |r'|, which is bounded for polynomial paths. On other
    paths, it is sampled.
    """
    bounds = pace_bounds(on.path, low, high)
    if bounds is not None:
        return np.where(high > low, bounds.change * (high - low) ** 2 / 8, 0.0)
    z = np.linspace(0.0, 1.0, SAMPLES)
    u = low[:, None] + (high - low)[:, None] * z
    first, last = on.at(low), on.at(high)
    chord = first[:, None] + (last - first)[:, None] * z
    return RESERVE * np.max(np.abs(on.at(u.ravel()).reshape(u.shape) - chord), axis=1)
