"""Find the durations that motions between two states can have, on the host."""

import math
from collections.abc import Callable

from qtraj.motion.profiles.jerk_limited.between import Task, scaled
from qtraj.motion.profiles.jerk_limited.in_time import bisected, ramp_to, rests
from qtraj.motion.profiles.jerk_limited.search import minimum_duration
from qtraj.motion.profiles.jerk_limited.structures import Ends

SAMPLES = 256
"""Number of coasting rates at which `possible_durations` looks for changes of sign."""
ROUND_OFF = 1e-9
"""Relative difference up to which the minimum is the end of an interval."""


def durations_text(task: Task) -> str:
    """Describe the durations of the motions of a concrete task: the minimum, and intervals with a coast."""
    time, braking, ends, max_rate = scaled(task)
    before, minimum = float(braking.widths.sum()), minimum_duration(ends, max_rate)
    intervals = possible_durations(ends, float(max_rate))
    if not any(low <= minimum * (1 + ROUND_OFF) <= high for low, high in intervals):
        intervals = sorted([(minimum, minimum), *intervals])
    return " or ".join(_interval_text(*(float(time) * (before + x) for x in pair)) for pair in intervals)


def _interval_text(low: float, high: float) -> str:
    if low == high:
        return f"{low:.9g} s"
    return f"at least {low:.9g} s" if math.isinf(high) else f"from {low:.9g} to {high:.9g} s"


def possible_durations(ends: Ends, max_rate: float) -> list[tuple[float, float]]:
    """Return the intervals of durations for which `coast_in_time` finds a motion, in ascending order.

    Where the time of the coast is not negative, the duration decreases with |w|. The ends of these intervals are at the
    rates without a coast, which are refined from changes of sign.
    """

    def left(w: float) -> float:
        return float(ends.distance) - sum(ramp_to(w, float(v), float(b)).distance for v, b in _states(ends))

    def lasts(w: float) -> float:
        return left(w) / w + sum(ramp_to(w, float(v), float(b)).time for v, b in _states(ends)) if w else math.inf

    found = []
    for sense in (1.0, -1.0):
        top = _top(lambda w: sense * left(sense * w), max_rate, sum(map(abs, rests(ends))))  # noqa: B023
        rates = [top * k / SAMPLES for k in range(SAMPLES + 1)]
        inside = None
        for a, b in zip(rates, [*rates[1:], None], strict=True):
            good = sense * left(sense * a) >= 0
            if good and inside is None:
                inside = a if a == 0 else _crossing(left, sense, a, a - top / SAMPLES)
            if inside is not None and (b is None or sense * left(sense * b) < 0):
                end = a if b is None else _crossing(left, sense, a, b)
                found.append((lasts(sense * end), lasts(sense * inside)))
                inside = None
    return _merged(found)


def _states(ends: Ends) -> tuple[tuple[float, float], tuple[float, float]]:
    return (ends.v0, ends.b0), (ends.v1, ends.b1)  # pyright: ignore[reportReturnType]


def _top(left: Callable[[float], float], max_rate: float, start: float) -> float:
    """Return the limit on the rate, or without a limit a rate above which there is no coast."""
    if math.isfinite(max_rate):
        return max_rate
    top = max(start, 1e-300)
    while left(top) >= 0:
        top *= 2
    return top


def _crossing(left: Callable[[float], float], sense: float, inside: float, outside: float) -> float:
    return bisected(lambda w: sense * left(sense * w) >= 0, inside, outside)


def _merged(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for low, high in sorted(x for x in intervals if x[1] > 0):
        if merged and low <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return merged
