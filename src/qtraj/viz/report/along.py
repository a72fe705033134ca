"""Compare two paths along their way: distance travelled, matching positions, lateral distance."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

WINDOW = 64
"""Number of intervals of the other path, before and after the expected position, in which the nearest is searched."""
CHUNK = 2048
"""Number of points that are matched at the same time, which bounds the memory."""


class Match(NamedTuple):
    """For each point of a path, the nearest position on another path, seen from above.

    `way` (n,) [m] is the distance travelled on the other path up to this position, and never decreases; `lateral` (n,)
    [m] is the distance of the point from the other path, positive to the left of it.
    """

    way: np.ndarray
    lateral: np.ndarray


def distance_travelled(position: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return the length [m] of the polyline up to each point."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])


def match(position: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "m 3"]) -> Match:
    """Match the points of a path with the nearest positions on `other`, seen from above.

    Only positions near the same fraction of the length are compared, because a route may pass the same place several
    times.
    """
    way = distance_travelled(other)
    moved = np.concatenate([[True], np.diff(way) > 1e-9 * max(way[-1], 1e-300)])  # stops repeat one point
    line, along = other[moved, :2], way[moved]
    if len(line) < 2:
        return Match(np.zeros(len(position)), np.full(len(position), np.nan))
    own = distance_travelled(position)
    expected = own * along[-1] / max(own[-1], 1e-300)
    parts = [
        _nearest(position[k : k + CHUNK, :2], expected[k : k + CHUNK], line, along)
        for k in range(0, len(position), CHUNK)
    ]
    at, lateral = (np.concatenate(values) for values in zip(*parts, strict=True))
    return Match(np.maximum.accumulate(at), lateral)


def _nearest(
    points: Float[np.ndarray, "k 2"],
    expected: Float[np.ndarray, " k"],
    line: Float[np.ndarray, "m 2"],
    along: Float[np.ndarray, " m"],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance travelled on the line at the nearest position, and the lateral distance, of each point."""
    first = np.searchsorted(along, expected)[:, None] + np.arange(-WINDOW, WINDOW)
    rows = np.clip(first, 0, len(line) - 2)
    start, chord = line[rows], line[rows + 1] - line[rows]
    offset = points[:, None] - start
    squares = np.maximum(np.sum(chord**2, axis=2), np.finfo(float).tiny)
    fraction = np.clip(np.sum(offset * chord, axis=2) / squares, 0.0, 1.0)
    apart = offset - fraction[..., None] * chord
    best = np.argmin(np.sum(apart**2, axis=2), axis=1)[:, None]
    row, part = (np.take_along_axis(x, best, axis=1)[:, 0] for x in (rows, fraction))
    apart, chord = (np.take_along_axis(x, best[..., None], axis=1)[:, 0] for x in (apart, chord))
    left = np.sign(chord[:, 0] * apart[:, 1] - chord[:, 1] * apart[:, 0])
    return along[row] + part * (along[row + 1] - along[row]), left * np.linalg.norm(apart, axis=1)
