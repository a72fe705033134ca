"""Find motions of fixed durations that coast between two ramps, on the host, for arrays of any shape.

Each ramp uses the full jerk, and the full acceleration if it lasts long enough. The distance increases strictly with
the coasting rate w wherever the ramps fit into the duration, so sections of intervals find w. The times of the ramps
are smallest at the rates that the initial and the final acceleration reach without a peak. Between these rates, the sum
of the times is concave. So the rates at which the ramps fit form at most two intervals.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from qtraj.motion.profiles.jerk_limited.structures import Batch, Ends, half_distance, ramp

MAX_STEPS = 200
"""Number of sections of each interval, which end earlier at adjacent floats."""
POINTS = 63
"""Number of points of a section in all intervals together, at least one in each: NumPy computes 63 as fast as one."""
TOLERANCE = 1e-12
"""Relative error of the distance up to which a coast exists at an end of an interval."""


class Ramp(NamedTuple):
    """A ramp between a state and the coast: its sense ±1, its peak, the time at the peak, its time and its distance."""

    sense: Batch
    peak: Batch
    hold: Batch
    time: Batch
    distance: Batch


class Coast(NamedTuple):
    """A motion with a coast at the rate `rate` for the time `time`, between two ramps; NaN if there is none."""

    rate: Batch
    time: Batch
    first: Ramp
    last: Ramp


def ramp_to(w: Batch, v: Batch, b: Batch) -> Ramp:
    """Return the ramp from the rate v and the acceleration b to the constant rate w."""
    sense = np.where(w >= direct(v, b), 1.0, -1.0)
    c, b = sense * v - b**2 / 2, sense * b
    peak, hold = ramp(np.maximum(sense * w - c, 0.0))
    return Ramp(sense, peak, hold, 2 * peak - b + hold, sense * half_distance(c, b, peak, hold)[0])


def direct(v: Batch, b: Batch) -> Batch:
    """Return the rate at which the acceleration b vanishes if it is reduced at once."""
    return v + b * np.abs(b) / 2


def coast_in_time(ends: Ends, max_rate: Batch, duration: Batch) -> Coast:
    """Return the motion of the duration between `ends`."""

    def ramps(w: Batch) -> tuple[Ramp, Ramp]:
        return ramp_to(w, ends.v0, ends.b0), ramp_to(w, ends.v1, ends.b1)

    def spare(w: Batch) -> Batch:
        first, last = ramps(w)
        return duration - (first.time + last.time)

    def excess(w: Batch) -> Batch:
        first, last = ramps(w)
        return first.distance + last.distance + w * (duration - (first.time + last.time)) - ends.distance

    low, high = _intervals(spare, ends, max_rate, duration)
    size = np.abs(ends.distance) + duration * np.maximum(np.abs(ends.v0), np.abs(ends.v1))
    possible = (low <= high) & (excess(low) <= TOLERANCE * size) & (excess(high) >= -TOLERANCE * size)
    low, high = (np.where(possible[0], *x) for x in (low, high))
    w = np.where(possible.any(axis=0), bisected(lambda w: excess(w) <= 0, low, high), np.nan)
    return Coast(w, np.maximum(spare(w), 0.0), *ramps(w))


def rests(ends: Ends) -> tuple[Batch, Batch]:
    """Return the rates that the accelerations at both ends reach without a peak, in ascending order."""
    first, last = direct(ends.v0, ends.b0), direct(ends.v1, ends.b1)
    return np.minimum(first, last), np.maximum(first, last)


def _intervals(spare: Callable[[Batch], Batch], ends: Ends, max_rate: Batch, duration: Batch) -> tuple[Batch, Batch]:
    """Return both ends of the two intervals of coasting rates within ±`max_rate` at which the ramps fit.

    An interval that does not exist is NaN. If the ramps fit at all rates between `rests`, both intervals are the same.
    """
    low, high = rests(ends)
    middle = _slowest(ends, low, high)
    fits_low, fits_high, fits_middle = spare(low) >= 0, spare(high) >= 0, spare(middle) >= 0
    # Two ramps beyond `rests` last longer than the rate has changed twice, minus the initial accelerations.
    beyond = np.abs(duration) + np.abs(ends.b0) + np.abs(ends.b1)
    inside = np.stack(np.broadcast_arrays(low, high, low, high))
    outside = np.stack(np.broadcast_arrays(low - beyond, high + beyond, middle, middle))
    lowest, highest, inner_low, inner_high = bisected(lambda w: spare(w) >= 0, inside, outside)
    starts = [np.where(fits_low, lowest, np.nan), np.where(fits_middle, lowest, inner_high)]
    stops = [np.where(fits_middle, highest, inner_low), np.where(fits_high, highest, np.nan)]
    return np.maximum(np.stack(starts), -max_rate), np.minimum(np.stack(stops), max_rate)


def _slowest(ends: Ends, low: Batch, high: Batch) -> Batch:
    """Return the rate between `low` and `high` at which the ramps last longest: there, both gain the same rate."""
    first = direct(ends.v0, ends.b0) <= direct(ends.v1, ends.b1)
    change = np.where(first, ends.b1**2 - ends.b0**2, ends.b0**2 - ends.b1**2) / 2
    return np.clip((ends.v0 + ends.v1 + change) / 2, low, high)


def bisected(holds: Callable[[Batch], Batch], inside: Batch, outside: Batch) -> Batch:
    """Return numbers between `inside`, where a condition holds, and `outside`, next to where it ceases to hold.

    `holds` is called with arrays that have the shape of both and a new first axis.
    """
    inside, outside = np.broadcast_arrays(inside, outside)
    count = max(1, POINTS // max(inside.size, 1))
    parts = (np.arange(count + 2) / (count + 1)).reshape(-1, *(1,) * inside.ndim)
    for _ in range(MAX_STEPS):
        points = inside + parts * (outside - inside)
        points[-1] = outside
        held = holds(points[1:-1])
        last = np.where(held.all(axis=0), count, np.argmin(held, axis=0))[None]
        new = [np.take_along_axis(points, last + k, axis=0)[0] for k in (0, 1)]
        if np.all((new[0] == inside) & (new[1] == outside) | np.isnan(new[0])):
            break
        inside, outside = new
    return inside
