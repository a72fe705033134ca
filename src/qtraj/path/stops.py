"""Find the stops of a route, which are the intervals in which its speed is at most a threshold."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.path import pieces, progress

SAMPLES = 33
"""Number of instants in each segment at which the speed is sampled."""

GOLDEN_STEPS = 52
"""Number of golden-section steps for the minimum speed."""

PARTS, DIVISIONS = 16, 13
"""Number of parts into which each step divides an interval with a threshold crossing, and number of steps."""

GOLDEN = (5**0.5 - 1) / 2


class Segments(NamedTuple):
    """Unpadded segments of a route: starts (n,) [s], coefficients (n, terms, 3) and durations (n,) [s].

    `progress` (n, 4) is None if the coefficients are those of powers of the time (see `qtraj.path.progress`). Positions
    are relative to `origin` (3,) [m]; None is the origin of the world.
    """

    starts: Float[np.ndarray, " n"]
    coefficients: Float[np.ndarray, "n terms 3"]
    durations: Float[np.ndarray, " n"]
    progress: Float[np.ndarray, "n 4"] | None = None
    origin: Float[np.ndarray, " 3"] | None = None

    def part(self, rows: Any) -> "Segments":
        """Return some of the segments."""
        return self._each(lambda x: x[rows])

    def in_double(self) -> "Segments":
        """Return the segments in float64."""
        return self._each(lambda x: np.asarray(x, float))

    def _each(self, change: Callable[[np.ndarray], np.ndarray]) -> "Segments":
        own = None if self.progress is None else change(self.progress)
        return Segments(change(self.starts), change(self.coefficients), change(self.durations), own, self.origin)

    def known_progress(self) -> Float[np.ndarray, "n 4"]:
        """Return the progress of all segments, also of those that are polynomials in the time."""
        if self.progress is not None:
            return self.progress
        return np.tile(progress.IDENTITY.astype(self.starts.dtype), (len(self.starts), 1))

    @property
    def end(self) -> float:
        """The end [s] of the last segment."""
        return float(self.starts[-1] + self.durations[-1])

    @property
    def composed(self) -> Bool[np.ndarray, " n"]:
        """Whether a segment is a curve with a progress, and not a polynomial in the time."""
        return (self.known_progress() != progress.IDENTITY).any(axis=1)

    def in_time(self) -> "Segments":
        """Return the segments as polynomials in the time since their start."""
        if self.progress is None:
            return self
        return self._replace(coefficients=progress.in_time(self.coefficients, self.progress), progress=None)

    def values(self, i: np.ndarray, s: np.ndarray, order: int) -> list[np.ndarray]:
        """Return position and derivatives up to `order` of the segments `i` (...) at local times `s` (...) [s]."""
        terms = pieces.chosen(self.coefficients, i)
        if self.progress is None:
            return pieces.values(terms, s, order)
        return progress.values(terms, self.progress[i], s, order)

    def derivatives(self, i: np.ndarray, s: np.ndarray, order: int) -> Float[np.ndarray, "{order} 3 ..."]:
        """Return the derivatives 1 to `order` of the segments `i` at local times `s` (m, ...) [s]."""
        if self.progress is None:
            return pieces.derivatives(self.coefficients, i, s, order)
        return np.moveaxis(np.stack(self.values(i, s, order)[1:]), -1, 1)

    def rows(self, t: np.ndarray, order: int, side: str = "right") -> list[np.ndarray]:
        """Return position and derivatives up to `order`, each (m, 3), at times `t` (m,) [s].

        At a joint, `side` selects the earlier segment ("left") or the later segment ("right").
        """
        i = np.searchsorted(self.starts, t, side=side) - 1  # type: ignore[call-overload]
        i = np.clip(i, 0, len(self.starts) - 1)
        return self.values(i, t - self.starts[i], order)

    def sampled(self) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
        """Return sampled instants [s], each joint once, and the velocities [m/s], for polynomials in the time."""
        n, terms, _ = self.coefficients.shape
        k = np.arange(1, terms)
        u = np.linspace(0.0, 1.0, SAMPLES)
        scaled = self.coefficients[:, 1:] * (k * self.durations[:, None] ** (k - 1))[:, :, None]
        # A single matrix product; its rows are the sampled instants, and its columns are the segments and axes.
        v = u[:, None] ** (k - 1) @ np.moveaxis(scaled, 0, 1).reshape(terms - 1, 3 * n)
        v = np.moveaxis(v.reshape(SAMPLES, n, 3), 1, 0)
        t = self.starts[:, None] + self.durations[:, None] * u
        return np.append(t[:, :-1], t[-1, -1]), np.concatenate([v[:, :-1].reshape(-1, 3), v[-1, -1:]])

    def speed_sq_between(self, low: Float[np.ndarray, " m"]) -> Callable[[np.ndarray], np.ndarray]:
        """Return the squared speed [m²/s²] at times (..., m), in the segments that contain the times `low` (m,)."""
        i = np.clip(np.searchsorted(self.starts, low, side="right") - 1, 0, len(self.starts) - 1)
        k = np.arange(1, self.coefficients.shape[1])
        starts, terms = self.starts[i], np.moveaxis(self.coefficients[i, 1:], 1, 0) * k[:, None, None]

        def speed_sq(t: np.ndarray) -> np.ndarray:
            s, v = (t - starts)[..., None], terms[-1]
            for term in terms[-2::-1]:
                v = term + s * v
            return _dots(v, v)

        return speed_sq


def fastest(segments: Segments) -> float:
    """Return the largest sampled speed [m/s]."""
    return float(np.sqrt(_dots(*2 * [segments.in_time().sampled()[1]]).max()))


def stops(segments: Segments, threshold: float, relative: bool = False) -> list[tuple[float, float]]:
    """Return the intervals (start, end) [s] in which the speed is at most `threshold` [m/s], in order.

    If `relative` is true, the threshold is a fraction of the largest sampled speed. The speed is sampled at 33 instants
    of every segment. If the direction of the velocity changes by 90° or more between two samples, the minimum of the
    speed between them is located.
    """
    segments = segments.in_time()
    t, v = segments.sampled()
    dots, squares = _dots(v[1:], v[:-1]), _dots(v, v)
    threshold = threshold * float(np.sqrt(squares.max())) if relative else threshold
    dips = np.flatnonzero((dots <= 0) & (np.minimum(squares[1:], squares[:-1]) > threshold**2))
    if dips.size:
        lowest = _lowest(segments, t[dips], t[dips + 1])
        t = np.insert(t, dips + 1, lowest)
        squares = np.insert(squares, dips + 1, segments.speed_sq_between(lowest)(lowest))
    below = squares <= threshold**2
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


def _dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...k,...k", a, b)


def _lowest(segments: Segments, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the instants [s] of minimum speed in the intervals [`low`, `high`], by golden-section search."""
    speed_sq = segments.speed_sq_between(low)
    for _ in range(GOLDEN_STEPS):
        a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left = speed_sq(a) < speed_sq(b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    return 0.5 * (low + high)


def _crossings(
    segments: Segments, low: np.ndarray, high: np.ndarray, below: np.ndarray, threshold: float
) -> np.ndarray:
    """Return the instants [s] at which the speed crosses the `threshold` [m/s], one for each interval [low, high].

    `below` indicates for each interval whether the speed is at most the threshold at the start of the interval.
    """
    speed_sq, u = segments.speed_sq_between(low), np.arange(1, PARTS) / PARTS
    for _ in range(DIVISIONS):
        width = high - low
        inner = low + width * u[:, None]
        # Keep the first part, counted from `low`, in which the speed crosses the threshold.
        same = np.logical_and.accumulate((speed_sq(inner) <= threshold**2) == below)
        count = np.sum(same, axis=0)
        low, high = low + width * count / PARTS, np.where(count == PARTS - 1, high, low + width * (count + 1) / PARTS)
    return np.where(below, high, low)
