"""Compute the distance travelled until an instant, and the instant at a distance, on a path of any kind.

Distances are integrals of the speed by `path.arc_length`. For the instant, distances are tabulated in short intervals;
bisection in one of them, and Newton's method with the integral from the start, follow.
"""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float
from qtraj.foundation.namespace import in_numpy, matmul, repeat, stop_gradient, xp
from qtraj.foundation.types import Scalar
from qtraj.path.arc_length import arc_length

INTERVALS = 1024
"""Number of intervals of equal duration in which the distance is tabulated."""

BISECTIONS, CORRECTIONS = 40, 2
"""Bisection steps in an interval, and steps of Newton's method that then remove the error of the table."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2
"""Nodes and weights on [0, 1] for the distance in a part of an interval."""


def until(path: Any, t: Array) -> Scalar:
    """Return the distance [m] from the start of a path to the time `t` [s]."""
    return (_until if path.supports_numpy else _compiled_until)(path, t)


def time_at(path: Any, length: Array) -> Scalar:
    """Return the first time [s] at which the distance from the start of a path is `length` [m]."""
    return (_time_at if path.supports_numpy else _compiled_time_at)(path, length)


def _integral(path: Any, t: Array) -> Scalar:
    return arc_length(lambda u: norm(path.sampled(u, 1)[1]), as_float(t))


def _inverse(path: Any, length: Array) -> Scalar:
    fixed, wanted = stop_gradient(path), stop_gradient(length)
    duration = as_float(fixed.duration)
    wanted = wanted.astype(duration.dtype)
    low, high = _interval(fixed, duration, wanted)

    def correct(time: Scalar) -> Scalar:
        speed, error = _speed(fixed, time), _integral(fixed, time) - wanted
        closer = xp.clip(time - error / xp.where(speed > 0, speed, 1.0), low, high)
        better = (speed > 0) & (abs(_integral(fixed, closer) - wanted) < abs(error))
        return xp.where(better, closer, time)

    time = repeat(CORRECTIONS, correct, _bisected(fixed, duration, wanted))
    time = xp.where(wanted <= 0, 0.0, time)
    # The search is not differentiated. One final Newton step leaves the value unchanged and supplies the derivatives.
    speed = _speed(fixed, time)
    inside = (wanted > 0) & (time < duration) & (speed > 0)
    error = _integral(path, time) - length
    return time - xp.where(inside, (error - stop_gradient(error)) / xp.where(inside, speed, 1.0), 0.0)


def _interval(path: Any, duration: Scalar, wanted: Scalar) -> tuple[Scalar, Scalar]:
    """Return the times between which the distance `wanted` is reached, also if the table has an error."""
    start, step, _ = _tabulated(path, duration, wanted)
    return xp.maximum(start - step, 0.0), xp.minimum(start + 2 * step, duration)


def _bisected(path: Any, duration: Scalar, wanted: Scalar) -> Scalar:
    start, step, rest = _tabulated(path, duration, wanted)

    def halve(bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bounds
        middle = 0.5 * (low + high)
        before = _lengths(path, start[None], middle[None])[0] < rest
        return xp.where(before, middle, low), xp.where(before, high, middle)

    return start + repeat(BISECTIONS, halve, (xp.zeros_like(step), step))[1]


def _tabulated(path: Any, duration: Scalar, wanted: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Return start and duration [s] of the interval with the distance `wanted`, and the rest of the distance [m]."""
    step = duration / INTERVALS
    starts: Any = np.arange(INTERVALS).astype(duration.dtype) * step
    each = _lengths(path, starts, step * xp.ones_like(starts))
    before = xp.concatenate([0.0 * each[:1], xp.cumsum(each)])
    k = xp.clip(xp.searchsorted(before, wanted, side="left") - 1, 0, INTERVALS - 1)
    return starts[k], step, wanted - before[k]


def _lengths(path: Any, starts: Array, spans: Array) -> Array:
    """Return the distances (n,) [m] in intervals of `spans` (n,) [s] from `starts` (n,) [s]."""
    times = starts[:, None] + spans[:, None] * NODES.astype(starts.dtype)[None]
    speeds = norm(path.sampled(times.reshape(-1), 1)[1]).reshape(times.shape)
    return spans * matmul(speeds, WEIGHTS.astype(starts.dtype))


def _speed(path: Any, time: Scalar) -> Scalar:
    return norm(path.sampled(time[None], 1)[1])[0]


_compiled_until = eqx.filter_jit(_integral)
_until = in_numpy(_integral, _compiled_until)
_compiled_time_at = eqx.filter_jit(_inverse)
_time_at = in_numpy(_inverse, _compiled_time_at)
