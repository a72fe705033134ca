"""The largest value of a function on parts of a path: among dense samples, and refined with the digits of mpmath."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mpmath
import numpy as np

from .exact_motion import DIGITS, FLOATS

SAMPLES, ZOOM, STEPS = 1501, 65, 40
MOST, REFINED = 50, 3
"""Largest numbers of local maxima about which the samples are denser, and of those that are refined. A local maximum is
considered only if the function could reach the largest sample next to it. It exceeds a sample at most by about the
larger difference to its neighbours, also where it has a kink."""


class Span(NamedTuple):
    """A part of piece k of a path."""

    k: int
    start: float
    end: float


def largest(spans: Sequence[Span], value: Callable[..., Any], side: int = 1, precise: bool = True) -> Any:
    """Return the largest value times `side` of a function of the piece k, x and the arithmetic."""
    tops = [top for span in spans for top in _tops(value, side, span, SAMPLES)]
    if not precise:
        return max(top.value for top in tops)
    denser = [max(_tops(value, side, top.span, ZOOM), key=lambda x: x.reach) for top in _highest(tops, MOST)]
    return max(_refined(value, side, top.span) for top in _highest(denser, REFINED))


class _Top(NamedTuple):
    """A local maximum of samples: what the function could reach, the sample, and the part between its neighbours."""

    reach: float
    value: float
    span: Span


def _tops(value: Any, side: int, span: Span, count: int) -> list[_Top]:
    x = np.linspace(span.start, span.end, count)
    y = side * value(span.k, x, FLOATS)
    rise = np.diff(y)
    before, after = np.append(0.0, rise), np.append(-rise, 0.0)
    reach = y + np.maximum(before, after)
    return [
        _Top(float(reach[j]), float(y[j]), Span(span.k, float(x[max(j - 1, 0)]), float(x[min(j + 1, count - 1)])))
        for j in np.flatnonzero((before >= 0) & (after >= 0))
    ]


def _highest(tops: list[_Top], count: int) -> list[_Top]:
    """Return the local maxima in which the function could be largest, at most `count`, starting with the highest."""
    high = max(top.value for top in tops)
    return sorted((top for top in tops if top.reach >= high), reverse=True)[:count]


def _refined(value: Any, side: int, span: Span) -> Any:
    """Return the maximum of a function with one maximum, by golden sections."""

    def f(x: Any) -> Any:
        return side * value(span.k, x, DIGITS)

    low, high, ratio = mpmath.mpf(span.start), mpmath.mpf(span.end), (mpmath.sqrt(5) - 1) / 2
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
