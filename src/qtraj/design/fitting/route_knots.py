"""Choose the knots of a fitted route."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.foundation.arrays import as_float, concrete, require_positive

SPACING, STEPS = 1.0, 2
"""Minimum initial knot spacing, in units of time and in time steps of the recording; the longer one applies."""

MIN_DISTANCE = 0.2
"""Minimum distance of a knot from a stop, in knot spacings; closer knots are removed."""

END_TOLERANCE = 1e-6
"""Tolerance on the first and the last of the user's knots, relative to the duration."""


class Grid(NamedTuple):
    """The knots of a fit (m,), and their spacing; `fixed` if they are the user's. All in units of time."""

    knots: Float[np.ndarray, " m"]
    spacing: float
    fixed: bool


def read_knots(knots: Any, times: Float[np.ndarray, " n"], step: float, unit: float) -> Grid:
    """Return the first knots for samples at `times`, in units of time; `knots` [s] are the user's, or None.

    **Raises:** ValueError for knots that are not a positive spacing, or not times from 0 to the duration.
    """
    duration = float(times[-1])
    if knots is None:
        spacing = max(SPACING, STEPS * step)
        return Grid(without_gaps(equal_knots(duration, spacing), times), spacing, False)
    values = np.asarray(concrete(knots), float)
    if values.ndim == 0:
        require_positive(as_float(values), "knots", "s")
        spacing = min(float(values) / unit, duration)
        return Grid(without_gaps(equal_knots(duration, spacing), times), spacing, True)
    grid = _checked_knots(values, duration * unit) / unit
    grid[-1] = duration
    return Grid(grid, float(np.median(np.diff(grid))), True)


def equal_knots(duration: float, spacing: float) -> Float[np.ndarray, " m"]:
    """Return knots from 0 to the duration at equal intervals of about `spacing`."""
    return np.linspace(0.0, duration, max(1, round(duration / spacing)) + 1)


def without_gaps(knots: Float[np.ndarray, " m"], times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    """Remove the knots between two segments without samples: one segment bridges a gap with minimum jerk."""
    empty = np.histogram(times, knots)[0] == 0
    return knots[np.concatenate([[True], ~(empty[:-1] & empty[1:]), [True]])]


def with_stops(
    knots: Float[np.ndarray, " m"], stops: list[tuple[float, float]], required: tuple[float, ...] = ()
) -> tuple[Float[np.ndarray, " k"], Bool[np.ndarray, " segments"]]:
    """Replace the knots inside or close to a stop by the ends of the stop, and add the `required` knots.

    Returns the new knots, and for each segment whether it is a stop.
    """
    near = MIN_DISTANCE * float(np.median(np.diff(knots)))
    for t in required:
        stops = [part for a, b in stops for part in ([(a, t), (t, b)] if a < t < b else [(a, b)])]
    ends = np.array([*(t for stop in stops for t in stop), *required])
    kept = np.ones(len(knots), bool)
    for start, end in [*stops, *((t, t) for t in required)]:
        kept &= (knots < start - near) | (knots > end + near)
    first, last = knots[0], knots[-1]
    result = np.unique(np.concatenate([[first], knots[kept], ends, [last]]))
    is_stop = np.zeros(len(result) - 1, bool)
    is_stop[np.searchsorted(result, np.array([start for start, _ in stops], float))] = True
    return result, is_stop


def _checked_knots(times: np.ndarray, duration: float) -> np.ndarray:
    increasing = times.ndim == 1 and len(times) > 1 and np.all(np.diff(times) > 0)
    tolerance = END_TOLERANCE * duration
    if not increasing or abs(times[0]) > tolerance or abs(times[-1] - duration) > tolerance:
        raise ValueError(
            f"knots must be a spacing [s], or times that increase from 0 to the duration {duration:.9g} s, "
            f"but {times.tolist() if times.size < 8 else f'an array of {times.size} numbers'} was given"
        )
    return np.concatenate([[0.0], times[1:-1], [duration]])
