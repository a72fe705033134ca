"""Divide a path into windows: in each of them, a limit that changes along the way is constant or linear.

The distances at which a step changes have a small uncertainty (see `path.distances`). Windows next to each other
overlap there, so that the stricter value holds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.varying import Varying


class Windows(NamedTuple):
    """Intervals of the parameter of a path, from `low` to `high`, and the bounds of steps in them."""

    low: Float[np.ndarray, " m"]
    high: Float[np.ndarray, " m"]
    bounds: Float[np.ndarray, " m"]


def windows(limit: Varying) -> Windows:
    """Return the windows of a limit; for a linear one, the bounds are not used.

    Parts of the path without a limit have no window, unless the whole path has no limit.
    """
    on, bounds = limit.on, limit.values
    at = np.append(limit.starts, on.length)
    if limit.along.kind == "linear":
        ends = on.parameters(at)
        ends[[0, -1]] = on.ends[[0, -1]]
        return Windows(ends[:-1], ends[1:], bounds)
    low, high, kept = at[:-1], at[1:], np.isfinite(bounds)
    if not kept.any():
        return Windows(on.ends[:1], on.ends[-1:], np.array([limit.side * np.inf]))
    low, high, bounds = low[kept], high[kept], bounds[kept]
    same = (bounds[1:] == bounds[:-1]) & (low[1:] == high[:-1])
    low, high, bounds = low[np.append(True, ~same)], high[np.append(~same, True)], bounds[np.append(True, ~same)]
    starts, ends = on.parameters(low - on.uncertainty), on.parameters(high + on.uncertainty)
    return Windows(starts, np.where(high == on.length, on.ends[-1], ends), bounds)
