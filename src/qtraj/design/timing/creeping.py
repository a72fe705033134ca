"""Let a vehicle that creeps along a route progress evenly, because the timing of a shape does not depend on its speed.

Where a recorded vehicle creeps, the segments of a route are regular curves R(w) with a progress w(t) whose rate almost
vanishes. In the parameter t, the timing u̇²(u) would have a peak there that takes hundreds of cells. So the progress of
such a run of segments is replaced: its rate changes to a constant one and back again, along the same curves, and in the
same time unless the vehicle creeps for long. The route does not change outside the run. Where the vehicle creeps at an
end of the route, but is not at rest, the rate is constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.parts import known_segments
from qtraj.foundation.arrays import like, part
from qtraj.path import pieces, progress
from qtraj.path.route import Route, from_segments
from qtraj.path.stops import Segments

DIP = 0.5
"""The vehicle creeps where its rate of progress is below this fraction of a rate before and of a rate after it."""

SLOWEST = 0.2
"""Smallest constant rate, as a fraction of the rates at the ends; a vehicle that creeps longer takes less time."""

SAMPLES = 9
"""Number of instants in each segment at which the rate is compared."""

ROUNDING = 1e-9
"""Relative differences of the progress below this value are rounding errors."""

BISECTIONS = 60


class _Run(NamedTuple):
    """Successive segments from `first` to before `last`; at the ends w'' is zero, and w' is `ends`.

    At an end of the route where the vehicle is not at rest, the new rate is free, and `ends` is NaN.
    """

    first: int
    last: int
    ends: tuple[float, float]


class _Replaced(NamedTuple):
    """The starts of segments, the rows of their curves, their progress, and the time that it saves."""

    starts: Float[np.ndarray, " n"]
    rows: Int[np.ndarray, " n"]
    progress: Float[np.ndarray, "n 4"]
    saved: float = 0.0

    def earlier(self, time: float) -> _Replaced:
        return self._replace(starts=self.starts - time)


class _Progress(NamedTuple):
    """A progress as cubics: their starts in time, and their coefficients."""

    starts: Float[np.ndarray, " cubics"]
    coefficients: Float[np.ndarray, "cubics 4"]


def evenly(route: Route) -> Route:
    """Return a route of the same shape on which the vehicle does not creep; the same route if it does not creep."""
    if route.progress is None:
        return route
    s = known_segments(route)
    forward = np.where(_rates(s, 1).sum(axis=1) < 0, -1.0, 1.0)[:, None]  # progress decreases on reversed routes
    s = s._replace(progress=forward * s.known_progress())
    found = [run for run in _runs(s) if _creeps(s, run)]
    if not found:
        return route
    parts, at, saved = [], 0, 0.0
    for run in found:
        even = _even(s, run)
        parts += [_unchanged(s, at, run.first).earlier(saved), even.earlier(saved)]
        at, saved = run.last, saved + even.saved
    parts.append(_unchanged(s, at, len(s.starts)).earlier(saved))
    starts, rows, own = (np.concatenate([x[k] for x in parts]) for k in range(3))
    starts, own = (like(x, route.starts) for x in (starts, forward[rows] * own))
    chosen = part(route.coefficients, rows)
    return from_segments(starts, chosen, route.duration - saved, route.origin, own)


def _unchanged(s: Segments, first: int, last: int) -> _Replaced:
    own = slice(first, last)
    return _Replaced(s.starts[own], np.arange(first, last), s.known_progress()[own])


def _rates(s: Segments, order: int) -> Float[np.ndarray, "n samples"]:
    local = s.durations[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    return pieces.values(s.known_progress()[:, None, :, None], local, order)[order][..., 0]


def _runs(s: Segments) -> list[_Run]:
    """Return the runs of curves whose progress is continuous and increases, and whose w'' is zero at both ends."""
    w, rate, second = (_rates(s, order) for order in range(3))
    moves = s.composed & s.coefficients[:, 1:].any(axis=(1, 2))
    largest = rate.max(axis=1)
    size = np.maximum(largest[1:], largest[:-1])
    same = (s.coefficients[1:] == s.coefficients[:-1]).all(axis=(1, 2))
    joined = moves[1:] & moves[:-1] & (np.minimum(rate[:-1, -1], rate[1:, 0]) > ROUNDING * size)
    joined &= np.abs(rate[1:, 0] - rate[:-1, -1]) <= ROUNDING * size
    joined &= ~same | (np.abs(w[1:, 0] - w[:-1, -1]) <= ROUNDING * np.abs(w[1:, -1] - w[1:, 0]))
    bounds = np.concatenate([[0], np.flatnonzero(~joined) + 1, [len(moves)]])
    found = []
    for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        ends, most = np.array([rate[first, 0], rate[last - 1, -1]]), largest[first:last].max()
        ends[np.abs(ends) <= ROUNDING * most] = 0.0
        bends = np.abs([second[first, 0], second[last - 1, -1]]) * s.durations[first:last].sum()
        inside = rate[first:last].ravel()[1:-1]
        outside = np.array([first == 0, last == len(moves)]) & (ends > 0)
        ends, bends = np.where(outside, np.nan, ends), np.where(outside, 0.0, bends)
        if moves[first] and (inside > 0).all() and not (ends < 0).any() and (bends <= ROUNDING * most).all():
            found.append(_Run(first, last, (float(ends[0]), float(ends[1]))))
    return found


def _creeps(s: Segments, run: _Run) -> bool:
    rate = _rates(s.part(slice(run.first, run.last)), 1).ravel()
    before, after = np.maximum.accumulate(rate), np.maximum.accumulate(rate[::-1])[::-1]
    before, after = (np.where(np.isnan(x), rate.max(), y) for x, y in zip(run.ends, (before, after), strict=True))
    return bool((rate < DIP * np.minimum(before, after)).any())


def _even(s: Segments, run: _Run) -> _Replaced:
    """Return the segments that replace a run."""
    own = s.part(slice(run.first, run.last))
    w = _rates(own, 0)
    new = np.append(True, (own.coefficients[1:] != own.coefficients[:-1]).any(axis=(1, 2)))
    curves = np.flatnonzero(new)
    lasts = np.append(curves[1:], len(new)) - 1
    lengths = w[lasts, -1] - w[curves, 0]
    reached = np.concatenate([[0.0], np.cumsum(lengths)])
    given = float(own.durations.sum())
    fastest = np.nan_to_num(run.ends).max()
    total = min(given, _duration(run.ends, float(reached[-1]), SLOWEST * fastest)) if fastest > 0 else given
    even = _progress(run.ends, float(reached[-1]), total)
    joints = _times_at(even, reached[1:-1], total)
    local = np.union1d(even.starts, joints)
    cubic = np.searchsorted(even.starts, local, side="right") - 1
    curve = np.searchsorted(joints, local, side="right")
    found = progress.shifted(even.coefficients[cubic], local - even.starts[cubic])
    found[:, 0] += (w[curves, 0] - reached[:-1])[curve]
    return _Replaced(own.starts[0] + local, run.first + curves[curve], found, given - total)


def _duration(ends: tuple[float, float], length: float, rate: float) -> float:
    """Return the time of a progress of `length` with the rates `ends`, and the constant `rate` along its half."""
    return 0.5 * length * (1 / rate + sum(1 / (rate + end) for end in _with_free(ends, rate)))


def _progress(ends: tuple[float, float], length: float, total: float) -> _Progress:
    """Return a progress of `length` in the time `total` with the rates `ends`, and a constant rate along its half."""
    low, high = 0.0, 2 * length / total
    for _ in range(BISECTIONS):
        rate = 0.5 * (low + high)
        low, high = (rate, high) if _duration(ends, length, rate) > total else (low, rate)
    rate = 0.5 * (low + high)
    ends = _with_free(ends, rate)
    first, last = (0.25 * length / (rate + end) for end in ends)
    middle = total - 2 * (first + last)
    durations = np.array([first, first, middle, last, last])
    rises = (rate - ends[0]) / first, 0.0, 0.0, (ends[1] - rate) / last
    rates = ends[0], 0.5 * (ends[0] + rate), rate, rate, 0.5 * (rate + ends[1])
    seconds = np.array([0.0, rises[0], 0.0, 0.0, rises[3], 0.0])
    c = np.zeros((5, 4))
    c[:, 1], c[:, 2], c[:, 3] = rates, 0.5 * seconds[:-1], np.diff(seconds) / (6 * durations)
    steps = pieces.values(c[..., None], durations, 0)[0][:, 0]
    c[:, 0] = np.cumsum(steps) - steps
    return _Progress(np.cumsum(durations) - durations, c)


def _with_free(ends: tuple[float, float], rate: float) -> tuple[float, float]:
    """Return the rates at the ends; a free one is the constant `rate`."""
    start, end = (rate if np.isnan(x) else x for x in ends)
    return start, end


def _times_at(even: _Progress, goal: np.ndarray, total: float) -> np.ndarray:
    """Return the times at which a progress has the values `goal`, in order."""
    cubic = np.searchsorted(even.coefficients[:, 0], goal, side="right") - 1
    h = np.diff(np.append(even.starts, total))[cubic]
    c = even.coefficients[cubic]
    return even.starts[cubic] + progress.times_at(c, h, goal)
