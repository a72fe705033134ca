"""Stops of a route: the intervals in which its speed is at most a threshold."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.path import pieces

SAMPLES = 33
"""Number of instants in each segment at which the speed is sampled."""

HALVINGS = 52
"""Bisection steps for the ends of an interval, and golden-section steps for the lowest speed between two samples."""

GOLDEN = (5**0.5 - 1) / 2


class Segments(NamedTuple):
    """The unpadded segments of a route: starts (n,) [s], coefficients (n, terms, 3) and durations (n,) [s]."""

    starts: Float[np.ndarray, " n"]
    coefficients: Float[np.ndarray, "n terms 3"]
    durations: Float[np.ndarray, " n"]

    def rows(self, t: np.ndarray, order: int, side: str = "right") -> list[np.ndarray]:
        """Value and derivatives, each (m, 3), at times (m,); `side` selects the segment at a joint."""
        i = np.searchsorted(self.starts, t, side=side) - 1  # type: ignore[call-overload]
        i = np.clip(i, 0, len(self.starts) - 1)
        return pieces.values(self.coefficients[i], t - self.starts[i], order)

    def speed_sq(self, t: np.ndarray) -> np.ndarray:
        """The square of the speed at times (m,)."""
        return np.sum(self.rows(t, 1)[1] ** 2, axis=-1)


def fastest(segments: Segments) -> float:
    """The largest sampled speed [m/s]."""
    return float(np.sqrt(segments.speed_sq(_samples(segments)).max()))


def stops(segments: Segments, threshold: float) -> list[tuple[float, float]]:
    """The intervals (start, end) [s] in which the speed is at most `threshold` [m/s], in order.

    The speed is sampled at 33 instants of every segment, and its minimum is located where the velocity changes its
    direction by 90° or more between two samples.
    """
    t = _samples(segments)
    v = segments.rows(t, 1)[1]
    dots, squares = np.sum(v[1:] * v[:-1], axis=1), np.sum(v**2, axis=1)
    dips = np.flatnonzero((dots <= 0) & (np.minimum(squares[1:], squares[:-1]) > threshold**2))
    if dips.size:
        t = np.sort(np.concatenate([t, _lowest(segments, t[dips], t[dips + 1])]))
    below = segments.speed_sq(t) <= threshold**2
    if not below.any():
        return []
    edges = np.flatnonzero(below[1:] != below[:-1])
    crossings = _crossings(segments, t[edges], t[edges + 1], below[edges], threshold)
    ends = [*([t[0]] if below[0] else []), *crossings, *([t[-1]] if below[-1] else [])]
    intervals: list[tuple[float, float]] = []
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        if intervals and start <= intervals[-1][1]:
            intervals[-1] = (intervals[-1][0], float(end))
        else:
            intervals.append((float(start), float(end)))
    return intervals


def _samples(segments: Segments) -> np.ndarray:
    """The sampled instants: in every segment, and at each joint once."""
    u = np.linspace(0.0, 1.0, SAMPLES)[:-1]
    end = segments.starts[-1:] + segments.durations[-1:]
    return np.concatenate([(segments.starts[:, None] + segments.durations[:, None] * u).ravel(), end])


def _lowest(segments: Segments, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The instants of the lowest speed between two samples, by golden section."""
    for _ in range(HALVINGS):
        a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left = segments.speed_sq(a) < segments.speed_sq(b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    return 0.5 * (low + high)


def _crossings(
    segments: Segments, low: np.ndarray, high: np.ndarray, below: np.ndarray, threshold: float
) -> np.ndarray:
    """The instants at which the speed crosses the threshold between two samples; `below`: whether it begins below."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        same = (segments.speed_sq(middle) <= threshold**2) == below
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.where(below, high, low)
