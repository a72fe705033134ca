"""How far one path, as a row of points, leaves another."""

import numpy as np
from jaxtyping import Float


def departure(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> float:
    """The largest distance of `points` from the polyline `line`; NaN where nothing finite is given."""
    start, along = line[:-1], np.diff(line, axis=0)
    squares = np.sum(along**2, axis=1)
    offset = points[:, None] - start
    part = np.clip(np.sum(offset * along, axis=2) / np.where(squares > 0, squares, 1.0), 0.0, 1.0)
    distances = np.linalg.norm(offset - part[..., None] * along, axis=2)
    return float(np.max(np.min(distances, axis=1)))
