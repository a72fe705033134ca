"""Divide a path into windows in which a limit that changes along the way has one value.

The distances at which the value changes have a small uncertainty (see `path.distances`). Windows next to each other
overlap there, so that the stricter value holds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.along import Along
from qtraj.path.distances import Distances

CHANGE = 1e-3
"""Largest relative change of a linear limit in a window; the strictest value in the window counts."""

MOST = 2**12
"""Largest number of windows of a linear limit between two distances at which values are given."""


class Windows(NamedTuple):
    """Intervals of the parameter of a path, from `low` to `high`, in each of which the bound is constant."""

    low: Float[np.ndarray, " m"]
    high: Float[np.ndarray, " m"]
    bounds: Float[np.ndarray, " m"]


def windows(along: Along, distances: Distances, side: int) -> Windows:
    """Return the windows of a limit on one path; `side` is −1 for a lower bound, and otherwise 1.

    Parts of the path without a limit have no window, unless the whole path has no limit.
    """
    at, low, high = _steps(along, distances.length)
    bounds = np.asarray(along.strictest(low, high, side) if along.kind == "linear" else np.asarray(along.values)[at])
    kept = np.isfinite(bounds)
    if not kept.any():
        return Windows(distances.ends[:1], distances.ends[-1:], np.array([side * np.inf]))
    low, high, bounds = low[kept], high[kept], bounds[kept]
    same = (bounds[1:] == bounds[:-1]) & (low[1:] == high[:-1])
    low, high, bounds = low[np.append(True, ~same)], high[np.append(~same, True)], bounds[np.append(True, ~same)]
    error = distances.uncertainty
    return Windows(distances.parameters(low - error), distances.parameters(high + error), bounds)


def _steps(along: Along, length: float) -> tuple[Any, np.ndarray, np.ndarray]:
    """Return the indices of the steps on the path, and the distances at which they start and end."""
    d = np.asarray(along.distance, float)
    d = np.append(d[d < length], length) if length > 0 else np.zeros(2)
    if along.kind == "step":
        return np.arange(d.size - 1), d[:-1], d[1:]
    values = np.abs(np.asarray(along.at(d), float))
    least, change = np.minimum(values[1:], values[:-1]), np.abs(np.diff(values))
    count = np.ceil(change / (CHANGE * np.maximum(least, change / (CHANGE * MOST) + (change == 0))))
    ends = [np.linspace(a, b, max(int(n), 1) + 1) for a, b, n in zip(d[:-1], d[1:], count, strict=True)]
    return None, np.concatenate([x[:-1] for x in ends]), np.concatenate([x[1:] for x in ends])
