"""Find the point on a path of any kind that is nearest to a given point."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array

from qtraj.algebra.vector import cross, dot, norm
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.namespace import in_numpy, repeat, stop_gradient, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import Flag, Scalar, Vec3

INTERVALS = 1024
"""Smallest number of intervals between the samples of a path; they have equal durations."""

TURN, USUAL = 0.4, 0.9
"""Largest turn [rad] of the path in an interval, and the quantile of the turns that must not exceed it; next to stops
and inflections some are always large."""

MOST_PARTS = 256
"""Largest number of parts into which the intervals are divided."""

STEPS = 8
"""Number of Newton steps that refine the samples."""


class Nearest(NamedTuple):
    """The point on a path nearest to a given point: its `time` [s], `position` (3,) [m] and `distance` [m].

    First derivatives of all three with respect to path and point are exact; at an end of the path the time is constant.
    """

    time: Scalar
    position: Vec3
    distance: Scalar

    def __repr__(self) -> str:
        return shown(self, time="s", position="m", distance="m")


def nearest(path: Any, point: Vec3) -> Nearest:
    """Find the point of a path that is nearest to `point` (3,) [m]."""
    turn = concrete((_turn if path.supports_numpy else _compiled_turn)(path))
    parts = 1 if turn is None or not turn > TURN else 2 ** int(np.ceil(np.log2(min(turn / TURN, MOST_PARTS))))
    return (_search if path.supports_numpy else _compiled_search)(path, point, parts)


def _times(path: Any, parts: int) -> Array:
    duration = as_float(path.duration)
    times: Any = np.linspace(0.0, 1.0, INTERVALS * parts + 1).astype(duration.dtype) * duration
    nodes = path.nodes()
    return times if nodes is None else xp.sort(xp.concatenate([times, nodes.astype(times.dtype)]))


def _usual_turn(path: Any) -> Scalar:
    """Return the turn [rad] of a path between two samples, which is exceeded in few intervals."""
    path = stop_gradient(path)
    _, v, a = path.sampled(_times(path, 1), 2)
    square = dot(v, v)
    rates = norm(cross(v, a)) / xp.where(square > 0, square, 1.0)
    return xp.quantile(xp.nan_to_num(rates), USUAL) * as_float(path.duration) / INTERVALS


def _nearest(path: Any, point: Vec3, parts: int) -> Nearest:
    fixed, target = stop_gradient((path, point))
    times = _times(fixed, parts)
    target = target.astype(times.dtype)
    low, high = xp.concatenate([times[:1], times[:-1]]), xp.concatenate([times[1:], times[-1:]])

    def newton(t: Array) -> Array:
        r, v, a = fixed.sampled(t, 2)
        offset = r - target[None]
        gradient, hessian = dot(offset, v), dot(v, v) + dot(offset, a)
        convex = hessian > 0
        step = xp.where(convex, -gradient / xp.where(convex, hessian, 1.0), -xp.sign(gradient) * (high - low) / 2)
        return xp.clip(t + step, low, high)

    both = xp.concatenate([times, repeat(STEPS, newton, times)])
    offset = fixed.sampled(both, 0)[0] - target[None]
    time = both[xp.argmin(dot(offset, offset))]
    r, v, a = (x[0] for x in path.sampled(time[None], 2))
    inside = (time > times[0]) & (time < times[-1])
    time = time + moved(r - point.astype(r.dtype), v, a, inside)
    position = path.sampled(time[None], 0)[0][0]
    return Nearest(time, position, norm(position - point))


def moved(offset: Vec3, v: Vec3, a: Vec3, inside: Flag) -> Scalar:
    """Return 0, with the derivatives of the time of the nearest point.

    The time satisfies (r − p)·v = 0 inside a path; at the ends it is constant. `offset` is r − p.
    """
    slope = stop_gradient(dot(v, v) + dot(offset, a))
    regular = inside & (slope > 0)
    value = dot(offset, v)
    return xp.where(regular, (stop_gradient(value) - value) / xp.where(regular, slope, 1.0), 0.0)


_compiled_turn = eqx.filter_jit(_usual_turn)
_turn = in_numpy(_usual_turn, _compiled_turn)
_compiled_search = eqx.filter_jit(_nearest)
_search = in_numpy(_nearest, _compiled_search)
