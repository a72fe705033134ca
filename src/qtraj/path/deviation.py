"""How far one path, as a row of points, leaves another."""

import numpy as np
from jaxtyping import Float

MOST = 1000
"""So many of the points are judged, evenly chosen."""

TOGETHER = 1_000_000
"""Pairs of a point and a piece of the line that are worked out at once: what they take stays small."""


def max_deviation(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> float:
    """The largest distance of `points`, or of `MOST` of them, from the polyline `line`; NaN where one is not finite."""
    chosen = points[np.unique(np.linspace(0, len(points) - 1, min(len(points), MOST)).round().astype(int))]
    parts = np.array_split(chosen, -(-len(chosen) * len(line) // TOGETHER))
    return float(np.max(np.concatenate([_distances(part, line) for part in parts])))


def _distances(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " n"]:
    start, along = line[:-1], np.diff(line, axis=0)
    squares = np.sum(along**2, axis=1)
    offset = points[:, None] - start
    part = np.clip(np.sum(offset * along, axis=2) / np.where(squares > 0, squares, 1.0), 0.0, 1.0)
    return np.min(np.linalg.norm(offset - part[..., None] * along, axis=2), axis=1)
