"""What of a panel is shown: the range of its axis, and components that stand near one apart from the others."""

import numpy as np

MOST = 0.95
"""A peak is a spike where this part of the values stay far below it."""
SPIKE = 10.0
"""How far: a spike is more than so many times as high."""
HEADROOM = 3.0
"""How far the picture goes above what most values reach, where there is a spike, or for a limit to be drawn."""
NEAR_ONE = 0.9
"""Of a component of a unit quaternion: the others are then all below 0.44, and would be flat lines beside it."""


def spike(values: list[np.ndarray]) -> tuple[float, float] | None:
    """The greatest magnitude that is shown, and the one that is there, where a few values dwarf all others.

    A single stop makes rates of 1e7 of a trihedron: the axis keeps to what the rest of the path has.
    """
    sizes = np.abs(np.concatenate([np.ravel(x) for x in values])) if values else np.zeros(0)
    sizes = sizes[np.isfinite(sizes)]
    if not sizes.size:
        return None
    most, peak = float(np.quantile(sizes, MOST)), float(sizes.max())
    return (HEADROOM * most, peak) if 0 < SPIKE * most < peak else None


def offsets(values: np.ndarray) -> list[float]:
    """For each component of quaternions (n, m) the 1 or −1 that it stays near, else 0."""
    found = []
    for column in values.T:
        known = column[np.isfinite(column)]
        near = known.size > 0 and float(np.abs(known).min()) >= NEAR_ONE
        found.append(float(np.sign(known[0])) if near and np.ptp(np.sign(known)) == 0 else 0.0)
    return found


def shifted(symbol: str, offset: float) -> str:
    """The name of a component that is drawn less its offset: "λ₀ − 1"."""
    return symbol if offset == 0 else f"{symbol} {'−' if offset > 0 else '+'} 1"
