"""The largest value of a function on parts of a path: among dense samples, and refined with the digits of mpmath."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mpmath
import numpy as np

from .exact_motion import DIGITS, FLOATS

SAMPLES, ZOOM, STEPS = 1501, 65, 40
NEAR, CLOSE, REFINED = 1e-4, 1e-6, 3
"""Local maxima of the samples that are lower than the largest one by more than `NEAR` of the range are ignored, and so
are those that are lower by more than `CLOSE` among denser samples. At most `REFINED` are refined."""


class Span(NamedTuple):
    """A part of piece k of a path."""

    k: int
    start: float
    end: float


def largest(spans: Sequence[Span], value: Callable[..., Any], side: int = 1, precise: bool = True) -> Any:
    """Return the largest value times `side` of a function of the piece k, x and the arithmetic."""
    tops, low = [], np.inf
    for span in spans:
        x = np.linspace(span.start, span.end, SAMPLES)
        y = side * value(span.k, x, FLOATS)
        low = min(low, float(y.min()))
        padded = np.concatenate([[-np.inf], y, [-np.inf]])
        peaks = np.flatnonzero((y >= padded[:-2]) & (y >= padded[2:]))
        tops += [(float(y[j]), span.k, float(x[max(j - 1, 0)]), float(x[min(j + 1, SAMPLES - 1)])) for j in peaks]
    high = max(top[0] for top in tops)
    if not precise:
        return high
    near = sorted((top for top in tops if top[0] >= high - NEAR * (high - low)), reverse=True)
    zoomed = sorted((_zoomed(value, side, *top[1:]) for top in near[:50]), reverse=True)
    close = [top for top in zoomed[:REFINED] if top[0] >= zoomed[0][0] - CLOSE * (high - low)]
    return max(_refined(value, side, *top[1:]) for top in close)


def _zoomed(value: Any, side: int, k: int, start: float, end: float) -> tuple[float, int, float, float]:
    x = np.linspace(start, end, ZOOM)
    y = side * value(k, x, FLOATS)
    j = int(np.argmax(y))
    return float(y[j]), k, float(x[max(j - 1, 0)]), float(x[min(j + 1, ZOOM - 1)])


def _refined(value: Any, side: int, k: int, start: float, end: float) -> Any:
    """Return the maximum of a function with one maximum, by golden sections."""

    def f(x: Any) -> Any:
        return side * value(k, x, DIGITS)

    low, high, ratio = mpmath.mpf(start), mpmath.mpf(end), (mpmath.sqrt(5) - 1) / 2
    ends = f(low), f(high)
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    x, y = f(a), f(b)
    for _ in range(STEPS):
        if x > y:
            high, b, y = b, a, x
            a = high - ratio * (high - low)
            x = f(a)
        else:
            low, a, x = a, b, y
            b = low + ratio * (high - low)
            y = f(b)
    return max(x, y, *ends)
