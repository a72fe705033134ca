"""Describe the duration of the fastest timing, and how far the minimum over all timings may be from it."""

from __future__ import annotations

import numpy as np

NOTED = 1e-3
"""Relative distance from the minimum duration above which the text says how to reduce it."""


def fastest_text(time: float, gap: float) -> str:
    """Return the text for a duration [s] and the relative distance `gap` from the minimum; NaN if not estimated."""
    if np.isnan(gap):
        return f"the fastest timing that was found takes {time:.6g} s"
    if gap <= NOTED:
        return f"the fastest timing takes {time:.6g} s (to within {max(100 * gap, 0.001):.2g} %)"
    shorter = f"up to {100 * gap:.2g} % shorter" if np.isfinite(gap) else "shorter by an unknown time"
    return (
        f"the fastest timing on these cells takes {time:.6g} s (the minimum over all timings may be {shorter}: pass a "
        "smaller tolerance, and no knots)"
    )
