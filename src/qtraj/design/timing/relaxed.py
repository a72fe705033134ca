"""Compute a timing that is at least as fast as the fastest one: limits couple speed and acceleration, which it ignores.

Let w be the squared speed and s the distance along the path. The limits imply an upper bound on w at each point, and
bounds on the acceleration dw/ds/2 along the path. The largest w(s) with both bounds takes two passes. It is the
fastest timing itself for limits on the speed, the lateral and the longitudinal acceleration and the rates of rotation.
"""

import functools
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.by_speed import BySpeed
from qtraj.design.timing.constraints import Parts, parts
from qtraj.design.timing.formula_limits import is_jerk
from qtraj.design.timing.linear_formulas import linear_limits
from qtraj.design.varying import strictest
from qtraj.path.quantity import COMBINED

PLACES = 5
"""Number of equidistant samples in each cell, both ends included."""

STEEP = 32.0
"""Where no limit bounds the acceleration, it is such that the speed can change within 1/`STEEP` of the path."""

Samples = Float[np.ndarray, "cells {PLACES}"]


class Relaxed(NamedTuple):
    """The relaxed timing at the samples of all cells: squared speeds w [m²/s²], and the times in the cells [s].

    `bounds` is whether the limits bound the acceleration everywhere, so that no timing is faster.
    """

    squares: Samples
    accelerations: Samples
    times: Float[np.ndarray, " cells"]
    bounds: bool


class Task(NamedTuple):
    """The limits by name, the parameters of a vehicle or None, and the largest squared speeds at both ends [m²/s²].

    The end of a `lap` is its start. `others` are the limits of further bodies.
    """

    bounds: dict[str, Any]
    vehicle: Any
    ends: tuple[float, float]
    lap: bool
    others: tuple[dict[str, Any], ...] = ()

    @property
    def jerk(self) -> float:
        """The lowest limit on the jerk or on an own quantity in its unit [m/s³], or infinity."""
        own = [abs(float(x)) for name, x in strictest(self.bounds).items() if is_jerk(name)]
        return min([np.inf, *own, *(float(strictest(x).get("jerk", np.inf)) for x in self.others)])


def relaxed(
    r: Float[np.ndarray, "3 components cells {PLACES}"],
    distances: Float[np.ndarray, "cells {PLACES}-1"],
    task: Task,
) -> Relaxed:
    """Return the relaxed timing for the derivatives `r` of the path, and the `distances` [m] between the samples.

    The components of several bodies are those of one path in a space of more dimensions.
    """
    square, length = squared_norm(r[0]), distances.sum()
    slowest, limits = (x.reshape(-1, *square.shape) for x in _of_bodies(r.reshape(3, -1, 3, square.size), task))
    slowest = slowest[0]
    highest = np.divide(square, slowest, out=np.full(square.shape, np.inf), where=(slowest > 0) & (square > 0))
    bounded = highest[np.isfinite(highest)].max(initial=0.0)
    for end, place in zip(task.ends, ((0, 0), (-1, -1)), strict=True):
        highest[place] = min(highest[place], end)
    known = limits[np.isfinite(limits)]
    most = bounded
    if not np.isfinite(highest).all() and known.size:  # what the accelerations can reach
        most = max(bounded, *(x for x in task.ends if np.isfinite(x)), 0.0) + 2 * known.max() * length
    most = most if most > 0 else 1.0
    complete = known.size == limits.size and not task.others
    limits = np.where(np.isfinite(limits), limits, STEEP * most / length)
    changes = np.zeros(limits.shape)
    changes[..., :-1] = 2 * np.minimum(limits[..., 1:], limits[..., :-1]) * distances
    laps = 3 if task.lap else 1
    rises, drops = changes.reshape(2, -1)
    squares = _reachable(np.minimum(highest, most).ravel(), rises, drops, laps).reshape(square.shape)
    speed = np.sqrt(squares)
    both = speed[:, 1:] + speed[:, :-1]
    times = np.divide(2 * distances, both, out=np.full(both.shape, np.inf), where=both > 0)
    low, high = limits.min(axis=0), limits.max(axis=0)
    return Relaxed(squares, np.where(low > 0, low, high), times.sum(axis=1), complete)


def _of_bodies(r: Float[np.ndarray, "3 bodies 3 samples"], task: Task) -> tuple[Any, Any]:
    """Return 1/a for the largest a = u̇² at the samples, and bounds on the acceleration and the deceleration [m/s²].

    For several bodies, the latter are approximations: the ratio of the speed of a body to that of all varies slowly.
    """
    one: Any = np.ones(())
    slowest, limits = [], []
    whole = np.sqrt(squared_norm(r[0].reshape(-1, r.shape[-1])))
    for own, bounds in zip(np.moveaxis(r, 1, 0), (task.bounds, *task.others), strict=True):
        found, pace = parts(own, one, bounds, task.vehicle), np.sqrt(squared_norm(own[0])) if task.others else whole
        slowest.append(_inverse_rates(found))
        share = np.divide(whole, pace, out=np.full(whole.shape, np.inf), where=pace > 0) if task.others else one
        limits.append(_accelerations(found, bounds, pace, slowest[-1]) * share)
    return np.max(slowest, axis=0), np.min(limits, axis=0)


def squared_norm(x: Float[np.ndarray, "components *samples"]) -> Float[np.ndarray, " *samples"]:
    """Return the sum of the squares of the components; faster than a sum over the first axis of an array."""
    found = x[0] * x[0]
    for row in x[1:]:
        found += row * row
    return found


def _reachable(highest: Any, rises: Any, drops: Any, laps: int) -> Float[np.ndarray, " samples"]:
    """Return the largest squared speeds up to `highest`, whose changes to the next sample are limited."""
    own = np.tile(highest, laps)
    up, down = (np.concatenate([[0.0], np.cumsum(np.tile(x, laps))[:-1]]) for x in (rises, drops))
    rising = np.minimum.accumulate(own - up) + up
    falling = np.minimum.accumulate((own + down)[::-1])[::-1] - down
    middle = highest.size * (laps // 2)
    return np.maximum(np.minimum(rising, falling), 0.0)[middle : middle + highest.size]


def _inverse_rates(p: Parts) -> Float[np.ndarray, " samples"]:
    """Return 1/a for the largest a = u̇² that the limits allow for the best a', and 0 if a is unbounded."""
    rows = [*p.upper, np.zeros(p.upper.shape[1:])]
    if p.combined is not None:
        rows.append(p.combined.upper)
    if p.road is not None:
        rows.append(p.road.upper)
    if p.formulas is not None:
        rows.append(p.formulas.highest)
    for (aa, ab), (_, bb) in p.forms:
        rows.append(np.sqrt(np.maximum(aa - np.divide(ab * ab, bb, out=np.zeros_like(bb), where=bb > 0), 0.0)))
    return np.max(rows, axis=0)


def _accelerations(
    p: Parts, bounds: dict[str, Any], pace: Float[np.ndarray, " samples"], slowest: Float[np.ndarray, " samples"]
) -> Any:
    """Return upper bounds on the acceleration and on the deceleration along the path [m/s²], or infinity.

    `slowest` are the inverses of the upper bounds on a = u̇². A limit that does not allow zero counts as zero.
    """
    both = [np.asarray(bounds[name]) for name in ("longitudinal_acceleration", "acceleration") if name in bounds]
    most = np.empty((2, *pace.shape))
    for k, (name, sign) in enumerate((("max", 1.0), ("min", -1.0))):
        side = bounds.get(f"longitudinal_acceleration_{name}", sign * np.inf)
        if isinstance(side, BySpeed):
            side = side.loosest(int(sign))
        most[k] = functools.reduce(np.minimum, both, np.maximum(sign * side, 0.0))
        if COMBINED in bounds:
            most[k] = np.minimum(most[k], (bounds[COMBINED].braking if k else bounds[COMBINED].accelerating).loosest(1))
    if p.formulas is not None:
        own = linear_limits(p.formulas).accelerations(slowest)
        most = np.minimum(most, np.maximum(own, 0.0))
    if p.road is None:
        return most
    steady, _, steep = p.road.along
    onto = p.road.onto[0] + np.abs(steady)
    grip = np.divide(0.5 * pace * onto, steep, out=np.full(pace.shape, np.inf), where=steep > 0)
    return np.minimum(most, grip)
