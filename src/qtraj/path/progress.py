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

from qtraj.foundation.namespace import in_numpy
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
    factorials = [math.factorial(k) for k in range(order + 1)]
    change = [x[..., None] / k for x, k in zip(rates, factorials, strict=True)]
    found = composed([x / k for x, k in zip(about, factorials, strict=True)], change)
    return [x * k for x, k in zip(found, factorials, strict=True)]


def composed(curve: list[Any], change: list[Any]) -> list[Any]:
    """Return the truncated Taylor coefficients of Σ curve_j δ^j with δ = Σ change_k t^k, k ≥ 1."""
    zero = 0.0 * curve[0]
    result = [curve[-1], *[zero] * (len(curve) - 1)]
    for row in curve[-2::-1]:
        product = [sum((change[i] * result[k - i] for i in range(1, k + 1)), zero) for k in range(len(curve))]
        result = [product[0] + row, *product[1:]]
    return result


@in_numpy
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
    powers = (1.0 - np.arange(TERMS)).reshape((1,) * factor.ndim + (TERMS,))
    return progress * factor[..., None] ** powers


def times_at(progress: np.ndarray, h: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Return the local times (...) at which the progress (..., 4) of segments has the values `goal` (...).

    Each progress must increase. `h` (...) are the durations.
    """
    low, high = np.zeros_like(goal), h + np.zeros_like(goal)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = pieces.values(progress[..., None], middle, 0)[0][..., 0] < goal
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
