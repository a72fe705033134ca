"""Compute the maximum distance of one path from another path; both paths are represented by sequences of points."""

import numpy as np
from jaxtyping import Float

MAX_POINTS = 1000
"""Maximum number of points whose distance is computed; a longer sequence is thinned evenly."""


def max_deviation(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> float:
    """Return the largest distance [m] of the `points` from the polyline `line`; NaN if a coordinate is not finite."""
    chosen = points[np.unique(np.linspace(0, len(points) - 1, min(len(points), MAX_POINTS)).round().astype(int))]
    start, along = (np.ascontiguousarray(x.T) for x in (line[:-1], np.diff(line, axis=0)))
    squares = np.sum(along**2, axis=0)
    inverse = 1 / np.where(squares > 0, squares, 1.0)
    return float(np.sqrt(np.max([_squared_distance(point, start, along, inverse) for point in chosen])))


def _squared_distance(
    point: Float[np.ndarray, " 3"],
    start: Float[np.ndarray, "3 m"],
    along: Float[np.ndarray, "3 m"],
    inverse: Float[np.ndarray, " m"],
) -> float:
    """Return the squared distance of a point from the nearest of many line segments.

    `start` are their first points, `along` their vectors, and `inverse` is 1 divided by their squared lengths.
    """
    offset = point[:, None] - start
    fraction = np.clip(np.einsum("cm,cm->m", offset, along) * inverse, 0.0, 1.0)
    offset -= fraction * along
    return np.min(np.einsum("cm,cm->m", offset, offset))
