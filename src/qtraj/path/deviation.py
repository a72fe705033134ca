"""Compute the maximum distance of one path from another path; both paths are represented by sequences of points."""

import numpy as np
from jaxtyping import Float

MAX_POINTS = 1000
"""Maximum number of points whose distance is computed; a longer sequence is thinned evenly."""

MAX_PAIRS = 1_000_000
"""Maximum number of pairs of a point and a segment that are processed together, to limit memory."""


def max_deviation(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> float:
    """Return the largest distance [m] of the `points` from the polyline `line`; NaN if a coordinate is not finite."""
    chosen = points[np.unique(np.linspace(0, len(points) - 1, min(len(points), MAX_POINTS)).round().astype(int))]
    parts = np.array_split(chosen, -(-len(chosen) * len(line) // MAX_PAIRS))
    return float(np.max(np.concatenate([_distances(part, line) for part in parts])))


def _distances(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " n"]:
    start, along = line[:-1], np.diff(line, axis=0)
    squares = np.sum(along**2, axis=1)
    offset = points[:, None] - start
    fraction = np.clip(np.sum(offset * along, axis=2) / np.where(squares > 0, squares, 1.0), 0.0, 1.0)
    return np.min(np.linalg.norm(offset - fraction[..., None] * along, axis=2), axis=1)
