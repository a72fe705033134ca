"""Cut, reverse and join the segments of routes, in NumPy; each function returns the arguments of `from_segments`."""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.foundation.arrays import concrete
from qtraj.foundation.seconds import seconds
from qtraj.path import pieces, progress
from qtraj.path.stops import Segments

JOINED = 1e-6
"""Maximum gap [m] between routes to be joined, or a few rounding errors of the coordinates if these are larger."""

Built = tuple[Any, Any, Any, Any, Any]
"""Starts, coefficients, duration, origin and progress of a route."""


def known(x: Any) -> np.ndarray:
    """Return the values of an array; raise a ValueError inside a trace."""
    value = concrete(x)
    if value is None:
        raise ValueError(
            "this method of a route needs concrete values, which are unavailable inside jit, grad and vmap. Divide, "
            "join and convert routes outside these transformations; inside, routes can only be evaluated."
        )
    return value


def rests(s: Segments) -> Float[np.ndarray, "k 2"]:
    """Return the intervals (start, end) [s] of the segments without motion; adjacent ones are one interval."""
    still = np.concatenate([[False], ~s.coefficients[:, 1:].any(axis=(1, 2)), [False]])
    edges, times = np.flatnonzero(still[1:] != still[:-1]), np.append(s.starts, s.end)
    return times[edges].reshape(-1, 2)


def unpadded(starts: Any, c: Any, duration: Any, origin: Any, own: Any) -> Built:
    """Return the segments of a route that has padding, from its arrays inside a trace.

    **Raises:** ValueError for numbers that are not finite, and for times that do not increase.
    """
    starts, duration = np.asarray(starts), np.asarray(duration)
    count = int(np.isfinite(starts).sum())
    kept = starts[:count], np.asarray(c)[:count], duration, np.asarray(origin)
    more = None if own is None else np.asarray(own)[:count]
    finite = all(np.isfinite(x).all() for x in (*kept, *([] if more is None else [more])))
    if not (count and finite and np.isposinf(starts[count:]).all() and (np.diff([*kept[0], duration]) > 0).all()):
        raise ValueError("the numbers of a route must be finite, and its times must increase")
    return *kept, more


def one(s: Segments, i: int, origin: np.ndarray) -> Built:
    """Return segment `i`."""
    own = None if s.progress is None else s.progress[i][None]
    return np.zeros(1, s.starts.dtype), s.coefficients[i][None], s.durations[i], origin, own


def window(s: Segments, t0: Any, t1: Any, duration: Any, origin: np.ndarray) -> Built:
    """Return the interval from `t0` to `t1` [s] of a route with this `duration`.

    **Raises:** ValueError if t0 ≥ t1 or the window is not within the route.
    """
    start, end, last = (float(np.asarray(seconds(x))) for x in (t0, t1, duration))
    if not 0 <= start < end <= last:
        raise ValueError(
            f"a window must lie within the route, from 0 to {last:.9g} s, and end after it starts, "
            f"but {start:.9g} to {end:.9g} s was given"
        )
    first = int(np.searchsorted(s.starts, start, "right")) - 1
    kept = slice(first, int(np.searchsorted(s.starts, end, "left")))
    c, starts = s.coefficients[kept].copy(), s.starts[kept] - start
    own = None if s.progress is None else s.progress[kept].copy()
    if own is None:
        c[:1] = pieces.shifted(c[:1], -starts[:1])
    else:
        own[:1] = progress.shifted(own[:1], -starts[:1])
    starts[0] = 0.0
    return starts, c, np.asarray(end - start, c.dtype), origin, own


def backwards(s: Segments, duration: np.ndarray, origin: np.ndarray) -> Built:
    """Return the same curve in the opposite direction, with the same durations of the segments."""
    starts = duration - np.append(s.starts, duration)[:0:-1]
    if s.progress is None:
        return starts, pieces.time_reversed(s.coefficients, s.durations)[::-1], duration, origin, None
    # The parameter of the curves changes its sign, so that it still increases.
    own = np.where(s.composed[:, None], -progress.time_reversed(s.progress, s.durations), progress.IDENTITY)
    c = s.coefficients * (-1.0) ** np.arange(s.coefficients.shape[1])[:, None]
    c = np.where(s.composed[:, None, None], c, pieces.time_reversed(s.coefficients, s.durations))
    return starts, c[::-1], duration, origin, own[::-1]


def joined(one: Segments, other: Segments, origins: tuple[np.ndarray, np.ndarray]) -> Built:
    """Return the segments of two routes, the second of which starts where the first ends.

    **Raises:** ValueError if there is a gap between the routes.
    """
    origin, later = origins
    end = one.rows(np.array([one.starts[-1] + one.durations[-1]]), 0)[0][0] + origin
    start = other.rows(np.zeros(1), 0)[0][0] + later
    gap, size = float(np.linalg.norm(start - end)), float(np.max(np.abs(start)))
    if gap > max(JOINED, 16 * size * float(np.finfo(start.dtype).eps)):
        raise ValueError(
            f"the second route starts at {start.tolist()}, but the first ends at {end.tolist()}, {gap:.6g} m away. "
            "Routes can be joined only if the second starts where the first ends."
        )
    degree = max(x.coefficients.shape[1] for x in (one, other))
    parts = [np.pad(x.coefficients, [(0, 0), (0, degree - x.coefficients.shape[1]), (0, 0)]) for x in (one, other)]
    parts[1][:, 0] += later - origin
    half = one.starts[-1] + one.durations[-1]
    starts = np.concatenate([one.starts, half + other.starts])
    own = None
    if one.progress is not None or other.progress is not None:
        own = np.concatenate([x.known_progress() for x in (one, other)])
    return starts, np.concatenate(parts), half + other.starts[-1] + other.durations[-1], origin, own
