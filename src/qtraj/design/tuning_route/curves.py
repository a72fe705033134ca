"""The curves of a route: what `tune_route` changes, if the segments next to stops are curves with a progress.

Consecutive segments that share a curve are one curve here, and a stop between two curves is only a joint. The curves
form a chain that never stops. Their parameter is the time, except next to stops. If the duration of a curve, in its
parameter, is multiplied by a factor, the durations of its segments are, too.

The functions accept NumPy arrays and, for derivatives, JAX arrays.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.path import pieces, progress
from qtraj.path.stops import Segments

INSIDE = 1e-3
"""Minimum distance of a node from the ends of a curve with a progress, as a fraction of the curve: at a stop,
quantities that depend on the direction of the velocity are undefined."""


class Curves(NamedTuple):
    """The curves of a route: their `first` and `last` segments (m,), and whether they have a progress (m,).

    `owner` (segments,) is the index of the curve of a segment, and −1 for a stop between curves. `sense` (m,) is 1, or
    −1 after an odd number of joints at which the vehicle reverses.
    """

    first: Int[np.ndarray, " m"]
    last: Int[np.ndarray, " m"]
    composed: Bool[np.ndarray, " m"]
    owner: Int[np.ndarray, " segments"]
    sense: Float[np.ndarray, " m"]

    @property
    def reversing(self) -> Float[np.ndarray, " m"] | None:
        """The `sense` of the curves, or None if the vehicle never reverses."""
        return self.sense if (self.sense < 0).any() else None

    def joint_rows(self) -> list[slice]:
        """Return the joints of the route that each joint (m + 1) of the chain stands for."""
        before = [0, *(self.last + 1).tolist()]
        after = [*self.first.tolist(), len(self.owner)]
        return [slice(a, b + 1) for a, b in zip(before, after, strict=True)]

    def at_rest(self) -> Bool[np.ndarray, " joints"]:
        """Return whether each joint of the chain is a stop between curves."""
        return np.array([own.stop - own.start > 1 for own in self.joint_rows()])


def curves_of(s: Segments) -> Curves:
    """Return the curves of a route."""
    count, composed = len(s.starts), s.composed
    if not composed.any():
        every = np.arange(count)
        return Curves(every, every, composed, every, np.ones(count))
    parked = ~composed & ~s.coefficients[:, 1:].any(axis=(1, 2))
    # Beyond the ends of the route, nothing prevents a stop from being a joint.
    between = parked & np.append(True, composed[:-1]) & np.append(composed[1:], True)
    same = composed[1:] & composed[:-1] & (s.coefficients[1:] == s.coefficients[:-1]).all(axis=(1, 2))
    starts = ~between & ~np.append(False, same)
    owner = np.where(between, -1, np.cumsum(starts) - 1)
    first = np.flatnonzero(starts)
    last = np.array([np.flatnonzero(owner == k)[-1] for k in range(len(first))])
    found = Curves(first, last, composed[first], owner, np.ones(len(first)))
    return found._replace(sense=_sense(found, s))


def _sense(of: Curves, s: Segments) -> Float[np.ndarray, " m"]:
    """Return the sense of the curves: it changes where two of them with a progress meet with opposite tangents."""
    c, h = chain(of, s.coefficients, s.durations, s.progress)
    cosines = np.sum(pieces.values(c, h, 1)[1][:-1] * c[1:, 1], axis=1)
    turns = of.composed[:-1] & of.composed[1:] & (cosines < 0)
    return np.cumprod(np.append(1.0, np.where(turns, -1.0, 1.0)))


def chain(of: Curves, c: Any, durations: Any, own: Any) -> tuple[Any, Any]:
    """Return the coefficients (m, terms, 3) of the curves and their durations (m,), both in their parameter.

    `c`, `durations` and `own` are the coefficients, durations and progress of the segments.
    """
    if own is None:
        return c, durations
    xp = pieces.arithmetic(c, durations, own)
    start = own[of.first, 0]
    end = pieces.values(own[of.last][..., None], durations[of.last], 0)[0][..., 0]
    c = pieces.shifted(c[of.first], start)
    return c, xp.where(of.composed, end - start, durations[of.first])


def stretch(of: Curves, s: Segments, h: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Return the durations of the curves in seconds, relative to those in their parameter `h`."""
    seconds = np.bincount(of.owner[of.owner >= 0], s.durations[of.owner >= 0], len(h))
    return np.where(of.composed, seconds / h, 1.0)


def rebuilt(of: Curves, durations: Any, own: Any, old: Any, c: Any, h: Any) -> tuple[Any, Any, Any]:
    """Return the durations, coefficients and progress of the segments for curves `c` with new durations `h`.

    `durations` and `own` are those of the given segments, and `old` the given durations of the curves.
    """
    if own is None:
        return h, c, None
    xp = pieces.arithmetic(durations, own, old, c, h)
    mine = np.maximum(of.owner, 0)
    factor = xp.where(of.owner >= 0, (h / old)[mine], 1.0)
    offset = np.where(of.composed[mine] & (of.owner >= 0), 1.0, 0.0) * own[of.first[mine], 0]
    shifted = own - offset[:, None] * np.eye(progress.TERMS)[:1]
    rows = c[mine]
    ends = pieces.values(c, h, 0)[0]
    before = np.maximum.accumulate(of.owner)
    after = np.minimum(before + 1, len(of.first) - 1)
    rest = xp.where((before < len(of.first) - 1)[:, None], c[after, 0], ends[before])
    resting = xp.zeros_like(rows) + np.eye(rows.shape[1])[0][None, :, None] * rest[:, None]
    rows = xp.where((of.owner >= 0)[:, None, None], rows, resting)
    return durations * factor, rows, progress.slowed(shifted, factor)


def rates(of: Curves, s: Segments, h: Float[np.ndarray, " m"], nodes: np.ndarray) -> Float[np.ndarray, "3 nodes k"]:
    """Return w', h w'' and h² w''' at the nodes, fractions of the k curves with a progress w and the durations `h`."""
    own, k = s.known_progress(), np.flatnonzero(of.composed)
    base = np.append(0.0, np.cumsum(h[k]))
    owned = np.concatenate([np.arange(of.first[i], of.last[i] + 1) for i in k])
    offset = np.concatenate([np.full(of.last[i] + 1 - of.first[i], base[j]) for j, i in enumerate(k)])
    start = np.concatenate([np.full(of.last[i] + 1 - of.first[i], own[of.first[i], 0]) for i in k])
    keys = offset + own[owned, 0] - start
    u = np.clip(nodes, INSIDE, 1 - INSIDE)[:, None]
    row = np.searchsorted(keys, base[:-1] + u * h[k], side="right") - 1
    goal = own[of.first[k], 0] + u * h[k]
    i = owned[row]
    t = progress.times_at(own[i], s.durations[i], goal)
    found = pieces.values(own[i][..., None], t, 3)
    return np.stack([found[1][..., 0], h[k] * found[2][..., 0], h[k] ** 2 * found[3][..., 0]])


def largest_of(of: Curves, values: Float[np.ndarray, "k segments"]) -> Float[np.ndarray, "k m"]:
    """Return the largest value of the segments of each curve."""
    found = np.full((len(of.first), len(values)), -np.inf)
    mine = of.owner >= 0
    np.maximum.at(found, of.owner[mine], values[:, mine].T)
    return found.T


def spread(of: Curves, values: Any, at_stop: Any) -> np.ndarray:
    """Return the values of the curves for each of their segments, and the value `at_stop` for stops between them."""
    values = np.asarray(values)
    found = values[np.maximum(of.owner, 0)]
    found[of.owner < 0] = at_stop
    return found


def joints_of(s: Segments) -> Float[np.ndarray, "joints 3"]:
    """Return the positions of the joints of a route, relative to its origin."""
    end = s.starts[-1] + s.durations[-1]
    return np.concatenate([s.rows(s.starts, 0)[0], s.rows(np.array([end]), 0)[0]])
