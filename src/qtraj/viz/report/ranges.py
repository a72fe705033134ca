"""Choose the axis range of a panel: without spikes, and without components that stay near 1."""

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
MARGIN = 1.05
"""End of an axis, divided by the largest magnitude that it shows."""


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


def without_near_one(values: np.ndarray, labels: list[str]) -> tuple[tuple[float, float] | None, str]:
    """Return an axis range that omits the columns of `values` (n, m) that stay near 1 or −1, and a note about them.

    The other components of a unit quaternion would otherwise look flat. The range is None, and the note empty, if no
    column stays near ±1.
    """
    near = [_stays_near_one(column) for column in values.T]
    if not any(near) or all(near):
        return None, ""
    others = values[:, ~np.array(near)]
    size = float(np.max(np.abs(others[np.isfinite(others)]), initial=0.0)) or 1.0
    texts = [_between(label, column) for label, column, omitted in zip(labels, values.T, near, strict=True) if omitted]
    return (-MARGIN * size, MARGIN * size), "; ".join(texts)


def _stays_near_one(column: np.ndarray) -> bool:
    finite = column[np.isfinite(column)]
    return finite.size > 0 and float(np.abs(finite).min()) >= NEAR_ONE and np.ptp(np.sign(finite)) == 0


def _between(label: str, column: np.ndarray) -> str:
    low, high = (f"{x:.6g}".replace("-", "−") for x in (np.nanmin(column), np.nanmax(column)))
    return f"{label}, between {low} and {high}, is outside the axis range"
