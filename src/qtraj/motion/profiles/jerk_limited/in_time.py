"""Find a motion of a fixed duration that coasts between two ramps, on the host.

Each ramp uses the full jerk, and the full acceleration if it lasts long enough. The distance increases strictly with
the coasting rate w wherever the ramps fit into the duration, so bisection finds w. The times of the ramps are smallest
at the rates that the initial and the final acceleration reach without a peak. Between these rates, the sum of the times
is concave. So the rates at which the ramps fit form at most two intervals.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from qtraj.motion.profiles.jerk_limited.structures import Ends

MAX_STEPS = 200
"""Number of steps of each bisection, which ends earlier at adjacent floats."""
GOLDEN_STEPS = 80
"""Number of steps of the golden-section search, which reduces an interval by more than the precision of floats."""
TOLERANCE = 1e-12
"""Relative error of the distance up to which a coast exists at an end of an interval."""


class Ramp(NamedTuple):
    """A ramp between a state and the coast: its sense ±1, its peak, the time at the peak, its time and its distance."""

    sense: float
    peak: float
    hold: float
    time: float
    distance: float


class Coast(NamedTuple):
    """A motion with a coast at the rate `rate` for the time `time`, between two ramps."""

    rate: float
    time: float
    first: Ramp
    last: Ramp


def ramp_to(w: float, v: float, b: float) -> Ramp:
    """Return the ramp from the rate v and the acceleration b to the constant rate w."""
    sense = 1.0 if w >= direct(v, b) else -1.0
    c, b = sense * v - b**2 / 2, sense * b
    gain = max(sense * w - c, 0.0)
    peak, hold = (math.sqrt(gain), 0.0) if gain <= 1 else (1.0, gain - 1)
    distance = c * (peak - b) - b**3 / 6 + c * hold + peak**2 * hold / 2 + peak * hold**2 / 2 + sense * w * peak
    return Ramp(sense, peak, hold, 2 * peak - b + hold, sense * distance)


def direct(v: float, b: float) -> float:
    """Return the rate at which the acceleration b vanishes if it is reduced at once."""
    return v + b * abs(b) / 2


def coast_in_time(ends: Ends, max_rate: float, duration: float) -> Coast | None:
    """Return the motion of the duration between `ends` (of scalars), or None if there is none."""

    def ramps(w: float) -> tuple[Ramp, Ramp]:
        return ramp_to(w, float(ends.v0), float(ends.b0)), ramp_to(w, float(ends.v1), float(ends.b1))

    def spare(w: float) -> float:
        return duration - sum(x.time for x in ramps(w))

    def excess(w: float) -> float:
        return sum(x.distance for x in ramps(w)) + w * spare(w) - float(ends.distance)

    size = abs(float(ends.distance)) + duration * max(abs(float(ends.v0)), abs(float(ends.v1)))
    for low, high in _intervals(spare, *rests(ends), max_rate):
        if excess(low) <= TOLERANCE * size and excess(high) >= -TOLERANCE * size:
            w = bisected(lambda x: excess(x) <= 0, low, high)
            return Coast(w, max(spare(w), 0.0), *ramps(w))
    return None


def rests(ends: Ends) -> tuple[float, float]:
    """Return the rates that the accelerations at both ends reach without a peak, in ascending order."""
    first, last = direct(float(ends.v0), float(ends.b0)), direct(float(ends.v1), float(ends.b1))
    return min(first, last), max(first, last)


def _intervals(spare: Callable[[float], float], low: float, high: float, max_rate: float) -> list[tuple[float, float]]:
    """Return the intervals of coasting rates within ±`max_rate` for which `spare` is not negative."""

    def fits(w: float) -> bool:
        return spare(w) >= 0

    middle = _argmin(spare, low, high)
    if fits(middle):
        inner = [(low, high)]
    else:
        inner = [(low, bisected(fits, low, middle))] if fits(low) else []
        inner += [(bisected(lambda w: not fits(w), middle, high), high)] if fits(high) else []
    outer = [(_outwards(fits, a, -1) if a == low else a, _outwards(fits, b, 1) if b == high else b) for a, b in inner]
    return [(max(a, -max_rate), min(b, max_rate)) for a, b in outer if a <= max_rate and b >= -max_rate]


def _outwards(fits: Callable[[float], bool], start: float, sense: int) -> float:
    """Return the rate furthest from `start` in one sense at which the ramps fit."""
    step = max(abs(start), 1e-300)
    while fits(start + sense * step):
        step *= 2
    return bisected(fits, start, start + sense * step)


def bisected(holds: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return a number between `inside`, where a condition holds, and `outside`, next to where it ceases to hold."""
    for _ in range(MAX_STEPS):
        middle = (inside + outside) / 2
        if middle in (inside, outside):
            break
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside


def _argmin(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the minimiser of a convex function by golden-section search."""
    ratio = (5**0.5 - 1) / 2
    for _ in range(GOLDEN_STEPS):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if function(a) <= function(b) else (a, high)
    return (low + high) / 2
