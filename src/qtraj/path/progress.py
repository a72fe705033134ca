"""Compose the curve of a segment with the progress of the vehicle along it.

A segment that starts or ends at a stop is the composition r(t) = R(w(t)) of a regular curve R and a cubic w, the
*progress*. The derivative of w is zero at the stop, but the derivative of R is not, so the curve has a direction and a
curvature there. Segments may share a curve. Other segments have the progress w(t) = t − start.

The functions accept NumPy arrays and, inside a trace, JAX arrays. `c` (..., terms, 3) are the ascending coefficients of
the curves in w, and `progress` (..., 4) those of w in the time since the start of the segment.
"""

import math
from typing import Any

import numpy as np

from qtraj.path import pieces

TERMS = 4
"""Number of coefficients of the progress."""

BISECTIONS = 53
"""Number of bisections for the time at which the progress has a given value."""

IDENTITY = np.array([0.0, 1.0, 0.0, 0.0])
"""The progress of a segment that is a polynomial in the time."""


def values(c: Any, progress: Any, s: Any, order: int) -> list[Any]:
    """Return position and derivatives (..., 3) with respect to the time, at local times `s` (...), as a list."""
    rates = [x[..., 0] for x in pieces.values(progress[..., None], s, order)]
    about = pieces.values(c, rates[0], order)
    # Taylor's series of R about w(s), at the series of w without its first term, by Horner's rule in truncated series.
    step = [0.0 * rates[0], *(x / math.factorial(k) for k, x in enumerate(rates[1:], start=1))]
    series = [about[order] / math.factorial(order), *[0.0 * about[0]] * order]
    for k in range(order - 1, -1, -1):
        series = _product(series, step, order)
        series[0] = series[0] + about[k] / math.factorial(k)
    return [math.factorial(k) * x for k, x in enumerate(series)]


def _product(vectors: list[Any], scalars: list[Any], order: int) -> list[Any]:
    """Return the product of two series up to `order`; the first term of `scalars` is zero."""
    found = [0.0 * vectors[0]]
    for k in range(1, order + 1):
        found.append(sum(scalars[j][..., None] * vectors[k - j] for j in range(1, k + 1)))
    return found


def in_time(c: Any, progress: Any) -> Any:
    """Return the coefficients (..., terms, 3) of the segments as polynomials in the time."""
    terms, degree = c.shape[-2], TERMS - 1
    xp = pieces.arithmetic(c, progress)
    result = c[..., -1:, :]
    for k in range(terms - 2, -1, -1):
        size = result.shape[-2]
        rows = [xp.zeros_like(result[..., :1, :])] * (size + degree)
        for i in range(size):
            for j in range(TERMS):
                rows[i + j] = rows[i + j] + progress[..., j, None, None] * result[..., i : i + 1, :]
        rows[0] = rows[0] + c[..., k : k + 1, :]
        result = xp.concatenate(rows, axis=-2)
    return result


def shifted(progress: Any, s: Any) -> Any:
    """Return the progress (n, 4) in the time since the local times `s` (n,)."""
    return pieces.shifted(progress[..., None], s)[..., 0]


def time_reversed(progress: Any, h: Any) -> Any:
    """Return the progress (n, 4) in the time until the end; `h` (n,) are the durations."""
    return pieces.time_reversed(progress[..., None], h)[..., 0]


def slowed(progress: Any, factor: Any) -> Any:
    """Return the progress (n, 4) along curves whose parameter, like the time, is multiplied by `factor` (n,)."""
    return progress * factor[..., None] ** (1.0 - np.arange(TERMS))


def times_at(progress: np.ndarray, h: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Return the local times (...) at which the progress (..., 4) of segments of durations `h` (...) has the values `goal`.

    Each progress must increase.
    """
    low, high = np.zeros_like(goal), h + np.zeros_like(goal)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = pieces.values(progress[..., None], middle, 0)[0][..., 0] < goal
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
