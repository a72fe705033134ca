"""The parts of a path that are timed one by one: all of it, or the drives of a route between its stops."""

from itertools import pairwise
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from qtraj.design.timing.directions import STANDS
from qtraj.design.timing.grid import Grid, of_segments, uniform
from qtraj.foundation.arrays import concrete
from qtraj.path import pieces
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.stops import Segments, fastest, stops

CONTINUOUS = 1e-6
"""Relative jump of the velocity, and of the acceleration, at a joint that counts as none."""

SAMPLES = 33

SLOW = 0.02
"""A speed below this part of the largest is slow."""


class Part(NamedTuple):
    """A part of a path in its own parameter, from `start` to `end` [s], with its cells; None for a stop."""

    start: Any
    end: Any
    grid: Grid | None


def of_path(path: AbstractHodograph, knots: int, jerk: bool) -> tuple[list[Part], tuple[bool, bool]]:
    """The parts in their order, and whether the path itself stands at its start and at its end.

    **Raises:** ValueError for a route inside a trace, many routes, one that never moves or stops within a segment, or
    one whose velocity (or acceleration, with a limit on the jerk) jumps.
    """
    if not isinstance(path, Route):
        return [Part(np.zeros(()), path.duration, uniform(knots))], (False, False)
    segments = known_segments(path)
    slow = standing_ends(segments)
    still = np.asarray(~segments.coefficients[:, 1:].any(axis=(1, 2)))
    if still.all():
        raise ValueError("this route stands from its start to its end, so there is nothing to time")
    _require_no_stop_within(segments, still)
    starts = np.append(segments.starts, segments.starts[-1] + segments.durations[-1])
    cut = slow[1:, 0] | slow[:-1, 1]
    _require_smooth(segments, cut, jerk)
    bounds = [0, *(np.flatnonzero(cut) + 1).tolist(), still.size]
    parts = []
    for first, last in pairwise(bounds):
        cells = max(knots, 1 << (2 * (last - first) - 1).bit_length())
        grid = None if still[first] else of_segments(starts[first : last + 1], first, cells)
        parts.append(Part(starts[first], starts[last], grid))
    return parts, (bool(slow[0, 0]), bool(slow[-1, 1]))


def known_segments(route: Route) -> Segments:
    """The segments of a known route in NumPy arrays.

    **Raises:** ValueError for many routes, or inside a trace.
    """
    if route.duration.ndim or any(isinstance(x, Tracer) for x in jax.tree.leaves(route)):
        raise ValueError(
            "a route is retimed with its numbers known: call retime outside jit, grad and vmap with respect to the "
            "route, once for each. Its limits may be traced."
        )
    count = route.segments
    starts, c = (np.asarray(x, float)[:count] for x in (route.starts, route.coefficients))
    return Segments(starts, c, np.diff(np.append(starts, float(np.asarray(route.duration)))))


def standing_ends(s: Segments) -> np.ndarray:
    """Whether each segment stands at its start and at its end, (n, 2)."""
    speeds = _speeds(s)
    return speeds[:, [0, -1]] <= STANDS * speeds.max(axis=1, keepdims=True)


def _speeds(s: Segments) -> Float[np.ndarray, "n samples"]:
    local = s.durations[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    c = np.broadcast_to(s.coefficients[:, None], (*local.shape, *s.coefficients.shape[1:]))
    return np.linalg.norm(pieces.values(c, local, 1)[1], axis=-1)


def _require_no_stop_within(s: Segments, still: np.ndarray) -> None:
    local = s.durations[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    c = np.broadcast_to(s.coefficients[:, None], (*local.shape, *s.coefficients.shape[1:]))
    v = pieces.values(c, local, 1)[1]
    turns = np.sum(v[:, 1:] * v[:, :-1], axis=-1) < 0
    if (found := np.argwhere(turns & ~still[:, None])).size:
        i, k = found[0]
        at = float(s.starts[i] + local[i, k])
        raise ValueError(
            f"the route turns back at about {at:.4g} s, within a segment, but retime cuts a route only at joints where "
            f"it stands. {_advice(s, at)}"
        )


def _advice(s: Segments, at: float) -> str:
    """What to do with a route that turns back at a time, most often in the slow motion beside a stop."""
    slow = next(
        ((a, b) for a, b in stops(s, SLOW * fastest(s)) if a <= at + s.durations.max() / SAMPLES and at <= b), None
    )
    parts = f"before {slow[0]:.6g} s and after {slow[1]:.6g} s, where it is not slow," if slow else "before and after"
    return (
        f"Take its parts {parts} by window(t0, t1), retime each with end_speed=0 or start_speed=0 for rest, or call "
        "tune_route, which keeps slow motion as it is."
    )


def _require_smooth(s: Segments, cut: np.ndarray, jerk: bool) -> None:
    ends = pieces.values(s.coefficients[:-1], s.durations[:-1], 2)
    for order, name in ((1, "velocity"), *(((2, "acceleration"),) if jerk else ())):
        after = s.coefficients[1:, order] * (1, 1, 2)[order]
        jump = np.linalg.norm(after - ends[order], axis=-1)
        size = np.linalg.norm(s.coefficients[:, 1:3], axis=-1)[:, order - 1].max(initial=0.0) + np.linalg.norm(
            ends[order], axis=-1
        )
        bad = np.flatnonzero((jump > CONTINUOUS * size) & ~cut)
        if bad.size:
            at = s.starts[bad[0] + 1]
            raise ValueError(
                f"the {name} of the route jumps at {at:.4g} s, where the vehicle moves, so no timing satisfies a limit "
                f"on the {('acceleration', 'jerk')[order - 1]}. Fit the path by a route with continuous "
                "accelerations, such as fit_route returns."
            )


def known_zero(v: Any) -> bool:
    """Whether a speed is known to be zero."""
    return v is not None and concrete(v) is not None and float(v) == 0
