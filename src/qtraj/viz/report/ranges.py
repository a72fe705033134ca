"""Choose the axis range of a panel, and offsets for components that stay near 1."""

import numpy as np

QUANTILE = 0.95
"""Quantile of the values with which a peak is compared."""
SPIKE = 10.0
"""Factor by which a peak must exceed the quantile to count as a spike."""
HEADROOM = 3.0
"""If there is a spike, the axis ends at this multiple of the quantile, and limits above the end are not drawn.

Without a spike, limits above this multiple of the peak are not drawn.
"""
NEAR_ONE = 0.9
"""Magnitude from which a component of a unit quaternion is near ±1.

All other components are then below 0.44 in magnitude, and would look flat on a common axis.
"""


def spike(values: list[np.ndarray]) -> tuple[float, float] | None:
    """Return the top of the axis and the actual peak if a few values are much larger than all others, otherwise None.

    For example, the rate of a trihedral can reach 1e7 rad/s near a stop; the axis then shows all other values.
    """
    sizes = np.abs(np.concatenate([np.ravel(x) for x in values])) if values else np.zeros(0)
    sizes = sizes[np.isfinite(sizes)]
    if not sizes.size:
        return None
    usual, peak = float(np.quantile(sizes, QUANTILE)), float(sizes.max())
    return (HEADROOM * usual, peak) if 0 < SPIKE * usual < peak else None


def offsets(values: np.ndarray) -> list[float]:
    """Return 1 or −1 for each column of `values` (n, m) that stays near this value, and 0 for all other columns."""
    result = []
    for column in values.T:
        finite = column[np.isfinite(column)]
        near = finite.size > 0 and float(np.abs(finite).min()) >= NEAR_ONE
        result.append(float(np.sign(finite[0])) if near and np.ptp(np.sign(finite)) == 0 else 0.0)
    return result


def shifted(symbol: str, offset: float) -> str:
    """Return the label of a component minus its offset, for example "λ₀ − 1"."""
    return symbol if offset == 0 else f"{symbol} {'−' if offset > 0 else '+'} 1"
