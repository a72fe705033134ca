"""Find the durations that motions between two states can have, on the host."""

import math
from collections.abc import Callable

import numpy as np

from qtraj.motion.profiles.jerk_limited.between import Task, scaled
from qtraj.motion.profiles.jerk_limited.in_time import Ramp, bisected, ramp_to, rests
from qtraj.motion.profiles.jerk_limited.search import minimum_duration
from qtraj.motion.profiles.jerk_limited.structures import Batch, Ends

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

    def ramps(w: Batch) -> tuple[Ramp, Ramp]:
        return ramp_to(w, ends.v0, ends.b0), ramp_to(w, ends.v1, ends.b1)

    def left(w: Batch) -> Batch:
        return float(ends.distance) - sum(x.distance for x in ramps(w))

    def lasts(w: Batch) -> Batch:
        coast = np.where(w == 0, np.inf, left(w) / np.where(w == 0, 1.0, w))
        return coast + sum(x.time for x in ramps(w))

    found = []
    for sense in (1.0, -1.0):
        top = _top(lambda w: sense * left(sense * w), max_rate, float(sum(map(abs, rests(ends)))))  # noqa: B023
        rates = top * np.arange(SAMPLES + 1) / SAMPLES

        def coasts(w: Batch, sense: float = sense) -> Batch:
            return sense * left(sense * w) >= 0

        good = np.concatenate([[False], coasts(rates), [False]])
        rates = np.concatenate([rates[:1], rates, rates[-1:]])
        first, last = np.flatnonzero(good[1:] & ~good[:-1]), np.flatnonzero(good[:-1] & ~good[1:])
        lowest, highest = bisected(coasts, rates[[first + 1, last]], rates[[first, last + 1]])
        found += zip(lasts(sense * highest).tolist(), lasts(sense * lowest).tolist(), strict=True)
    return _merged(found)


def _top(left: Callable[[float], Batch], max_rate: float, start: float) -> float:
    """Return the limit on the rate, or without a limit a rate above which there is no coast."""
    if math.isfinite(max_rate):
        return max_rate
    top = max(start, 1e-300)
    while left(top) >= 0:
        top *= 2
    return top


def _merged(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for low, high in sorted(x for x in intervals if x[1] > 0):
        if merged and low <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return merged
