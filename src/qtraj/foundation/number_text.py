"""Format columns of numbers for printed tables."""

import math

import numpy as np


def digits(values: np.ndarray, known: np.ndarray) -> list[str]:
    """Format a column of numbers with four significant digits.

    Values that are not finite, or for which `known` is false, are replaced by a dash.
    """
    return [f"{v:.4g}" if ok and np.isfinite(v) else "-" for v, ok in zip(values.tolist(), known, strict=True)]


def decimals(values: np.ndarray, known: np.ndarray) -> list[str]:
    """Format a column of numbers with at most six decimals, as many as the range of the values requires.

    Values that are not finite, or for which `known` is false, are replaced by a dash.
    """
    finite = values[known & np.isfinite(values)]
    size = float(np.abs(finite).max(initial=0.0))
    spread = float(np.ptp(finite)) if finite.size else 0.0
    before_point = 1 + max(0, _magnitude(size))
    decimals = min(max(4 - _magnitude(spread or size), 0), 6, max(10 - before_point, 0))
    return [
        f"{round(float(v), decimals) + 0.0:.{decimals}f}" if ok and np.isfinite(v) else "-"
        for v, ok in zip(values, known, strict=True)
    ]


def _magnitude(x: float) -> int:
    return math.floor(math.log10(x)) if x > 0 else 0
