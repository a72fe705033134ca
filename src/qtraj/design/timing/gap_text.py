"""Describe the duration of the fastest timing, and how far the minimum over all timings may be from it."""

from __future__ import annotations

import numpy as np

NOTED = 1e-3
"""Relative distance from the minimum duration above which the text does not call a timing the fastest one."""


def fastest_text(time: float, gap: float) -> str:
    """Return the text for a duration [s] and the relative distance `gap` from the minimum; NaN if not estimated."""
    if np.isnan(gap):
        return f"the fastest timing that was found takes {time:.6g} s"
    if gap <= NOTED:
        return f"the fastest timing takes {time:.6g} s (to within {max(100 * gap, 0.001):.2g} %)"
    known = f"no timing is shorter by more than {100 * gap:.2g} %" if np.isfinite(gap) else "a shorter one may exist"
    return f"the fastest timing that was found takes {time:.6g} s ({known})"
