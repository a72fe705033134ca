"""Format numbers, columns of numbers and intervals for printed tables."""

import math
from collections.abc import Sequence

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


def number(value: float | None, digits: int = 6, sign: str = "-") -> str:
    """Format a number with `digits` significant digits; None and numbers that are not finite become a dash.

    `sign`: "-" for a sign of negative numbers only, "+" for a sign of all numbers.
    """
    return "-" if value is None or not math.isfinite(value) else f"{value:{sign}.{digits}g}"


def degrees(value: float | None, digits: int = 6) -> str:
    """Format an angle [rad], or a derivative of an angle, in degrees; None and NaN become a dash."""
    return number(None if value is None else math.degrees(value), digits)


def intervals(bounds: Sequence[tuple[float, float]], most: int = 12) -> str:
    """Format the first `most` intervals, such as "0.00-1.25, 3.00-4.50"; further intervals are only counted."""
    listed = ", ".join(f"{a:.2f}-{b:.2f}" for a, b in bounds[:most])
    return f"{listed} and {len(bounds) - most} more" if len(bounds) > most else listed
