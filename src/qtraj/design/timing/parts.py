"""Divide a path into the parts that are timed separately: the whole path, or the drives of a route between stops."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.timing.directions import STANDS
from qtraj.design.timing.grid import Grid, of_segments, uniform
from qtraj.design.timing.standstill import with_stops
from qtraj.foundation.arrays import concrete, is_traced
from qtraj.path import pieces
from qtraj.path.driving import segments_of
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.stops import Segments, fastest, stops

CONTINUOUS = 1e-6
"""A relative jump of the velocity or the acceleration at a joint below this value counts as a rounding error."""

SAMPLES = 33

STOP_SPEED, STOP_DISTANCE = 0.2, 0.2
"""By default, motion at this speed [m/s] or less within this distance [m] is treated as a stop."""

SLOW = 0.02
"""A speed below this fraction of the highest speed counts as slow."""


class Part(NamedTuple):
    """A part of a path, from the parameter `start` to `end` [s], with its cells; `grid` is None for a stop.

    `stops` indicates whether the velocity of the path is zero at the start and at the end.
    """

    start: Any
    end: Any
    grid: Grid | None
    stops: tuple[bool, bool] = (False, False)


def standing(route: Route, speed: float | None, distance: float) -> Route:
    """Return the route with stops instead of slow motion.

    `speed` and `distance` are the arguments `stop_speed` and `stop_distance` of `retime`.
    """
    segments = known_segments(route)
    return with_stops(route, segments, min(STOP_SPEED, SLOW * fastest(segments)) if speed is None else speed, distance)


def of_path(
    path: AbstractHodograph, knots: int, jerk: bool, regular: bool = False
) -> tuple[list[Part], tuple[bool, bool]]:
    """Return the parts in order, and whether the velocity of a route is zero at its start and at its end.

    `jerk` indicates whether the jerk is limited, and `regular` whether it is known that the velocity is never zero.

    **Raises:** ValueError for a traced route, a batch of routes, a route without motion, a route that reverses within a
    segment, or a route whose velocity jumps. With a limit on the jerk, also for a route whose acceleration jumps.
    """
    if not isinstance(path, Route):
        return [Part(np.zeros(()), path.duration, uniform(knots))], (False, False)
    segments = known_segments(path)
    slow = standing_ends(segments)
    still = np.asarray(~segments.coefficients[:, 1:].any(axis=(1, 2)))
    if still.all():
        raise ValueError("the vehicle is at rest on the whole route, so there is nothing to retime")
    if not regular:
        _require_no_stop_within(segments, still)
    starts = np.append(segments.starts, segments.starts[-1] + segments.durations[-1])
    cut = slow[1:, 0] | slow[:-1, 1]
    _require_smooth(segments, cut, jerk)
    bounds = [0, *(np.flatnonzero(cut) + 1).tolist(), still.size]
    parts = []
    for first, last in pairwise(bounds):
        cells = max(knots, 1 << (2 * (last - first) - 1).bit_length())
        ends = bool(slow[first, 0]), bool(slow[last - 1, 1])
        grid = None if still[first] else of_segments(starts[first : last + 1], first, cells, ends)
        parts.append(Part(starts[first], starts[last], grid, ends))
    return parts, (bool(slow[0, 0]), bool(slow[-1, 1]))


def known_segments(route: Route) -> Segments:
    """Return the segments of a route with concrete values, in NumPy arrays.

    **Raises:** ValueError for a batch of routes or a traced route.
    """
    if route.duration.ndim or is_traced(route):
        raise ValueError(
            "retime needs a route with concrete values: call it once for each route, without jit, grad or vmap over "
            "the route. The limits may be traced."
        )
    return segments_of(route)


def standing_ends(s: Segments) -> np.ndarray:
    """Return whether the velocity is zero at the start and at the end of each segment, (n, 2)."""
    speeds = np.linalg.norm(_velocities(s), axis=-1)
    return speeds[:, [0, -1]] <= STANDS * speeds.max(axis=1, keepdims=True)


def _velocities(s: Segments) -> Float[Any, "n samples 3"]:
    local = _instants(s)
    return s.values(np.arange(len(local))[:, None] + np.zeros(SAMPLES, int), local, 1)[1]


def _instants(s: Segments) -> Float[Any, "n samples"]:
    return s.durations[:, None] * np.linspace(0.0, 1.0, SAMPLES)


def _require_no_stop_within(s: Segments, still: np.ndarray) -> None:
    local, v = _instants(s), _velocities(s)
    speeds = np.linalg.norm(v, axis=-1)
    v[speeds <= STANDS * speeds.max(axis=1, keepdims=True)] = 0.0  # rounding
    turns = np.sum(v[:, 1:] * v[:, :-1], axis=-1) < 0
    if (found := np.argwhere(turns & ~still[:, None])).size:
        i, k = found[0]
        at = float(s.starts[i] + local[i, k])
        raise ValueError(
            f"the route reverses at about {at:.4g} s, within a segment, but retime divides a route only at joints "
            f"where the vehicle is at rest. {_advice(s, at)}"
        )


def _advice(s: Segments, at: float) -> str:
    """Return advice on a route that reverses at the time `at` [s], typically in slow motion next to a stop."""
    slow = next(
        ((a, b) for a, b in stops(s, SLOW * fastest(s)) if a <= at + s.durations.max() / SAMPLES and at <= b), None
    )
    parts = f"before {slow[0]:.6g} s and after {slow[1]:.6g} s" if slow else "before and after this instant"
    return (
        f"Either extract the parts {parts} with route.window(t0, t1) and retime each of them, with end_speed=0 or "
        "start_speed=0 at an end at rest, or use tune_route instead of retime: it does not change segments at a stop."
    )


def _require_smooth(s: Segments, cut: np.ndarray, jerk: bool) -> None:
    s = s.in_time()
    ends = pieces.values(s.coefficients[:-1], s.durations[:-1], 2)
    for order, name in ((1, "velocity"), *(((2, "acceleration"),) if jerk else ())):
        after = s.coefficients[1:, order] * (1, 1, 2)[order]
        jump = np.linalg.norm(after - ends[order], axis=-1)
        size = np.linalg.norm(s.coefficients[:, order], axis=-1).max() + np.linalg.norm(ends[order], axis=-1)
        if order == 2:  # the added speed/duration keeps the scale positive where all accelerations are zero
            size = size + np.linalg.norm(s.coefficients[:, 1], axis=-1).max() / s.durations.max()
        bad = np.flatnonzero((jump > CONTINUOUS * size) & ~cut)
        if bad.size:
            at = s.starts[bad[0] + 1]
            raise ValueError(
                f"the {name} of the route jumps at {at:.4g} s, while the vehicle is moving, so retime cannot satisfy "
                f"a limit on the {('acceleration', 'jerk')[order - 1]} there. Use a route with continuous "
                "acceleration, such as the result of fit_route."
            )


def known_zero(v: Any) -> bool:
    """Return whether a speed is known to be zero."""
    return v is not None and concrete(v) is not None and float(v) == 0
