"""The range of a panel's axis, and offsets of components that stay near 1."""

import numpy as np

QUANTILE = 0.95
"""Quantile of the values with which a peak is compared."""
SPIKE = 10.0
"""A peak counts as a spike if it exceeds the quantile by this factor."""
HEADROOM = 3.0
"""Top of the axis relative to the quantile, if there is a spike; largest limit drawn, relative to the peak."""
NEAR_ONE = 0.9
"""If a component of a unit quaternion exceeds this, the others are below 0.44 and would look like flat lines."""


def spike(values: list[np.ndarray]) -> tuple[float, float] | None:
    """The top of the axis and the actual peak, if a few values are much larger than all others; otherwise None.

    At a single stop, the rate of a trihedral can reach 1e7; the axis then shows the rest of the path.
    """
    sizes = np.abs(np.concatenate([np.ravel(x) for x in values])) if values else np.zeros(0)
    sizes = sizes[np.isfinite(sizes)]
    if not sizes.size:
        return None
    usual, peak = float(np.quantile(sizes, QUANTILE)), float(sizes.max())
    return (HEADROOM * usual, peak) if 0 < SPIKE * usual < peak else None


def offsets(values: np.ndarray) -> list[float]:
    """For each column of the quaternions (n, m), 1 or −1 if the column stays near this value, otherwise 0."""
    result = []
    for column in values.T:
        finite = column[np.isfinite(column)]
        near = finite.size > 0 and float(np.abs(finite).min()) >= NEAR_ONE
        result.append(float(np.sign(finite[0])) if near and np.ptp(np.sign(finite)) == 0 else 0.0)
    return result


def shifted(symbol: str, offset: float) -> str:
    """The label of a component minus its offset: "λ₀ − 1"."""
    return symbol if offset == 0 else f"{symbol} {'−' if offset > 0 else '+'} 1"
