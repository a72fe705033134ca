"""Compute arc lengths along a route, and the time at a given arc length, by quadrature in each segment.

`starts` (rows,) [s], `c` (rows, terms, 3) and `duration` [s] are the start times, coefficients and duration of a
`Route`. A local time is measured from the start of a segment.
"""

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.namespace import in_numpy_or_jit, repeat, stop_gradient, xp
from qtraj.foundation.types import Scalar
from qtraj.path import pieces

NODES, PANELS = 12, 8
"""Gauss–Legendre nodes per panel, and panels per segment."""

STEPS = 60
"""Number of bisection steps for the time at a given arc length; the remaining error is round-off."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(NODES)
POINTS = ((np.arange(PANELS)[:, None] + (_NODES + 1) / 2) / PANELS).ravel()
WEIGHTS = np.tile(_WEIGHTS / (2 * PANELS), PANELS)


@in_numpy_or_jit
def total(starts: Array, c: Array, duration: Scalar) -> Scalar:
    """Return the length [m] of the whole route."""
    return xp.sum(lengths(starts, c, duration))


@in_numpy_or_jit
def until(starts: Array, c: Array, duration: Scalar, t: Scalar) -> Scalar:
    """Return the length [m] from the start to the time `t` [s]."""
    i = xp.maximum(xp.searchsorted(starts, t, side="right") - 1, 0)
    before = xp.where(np.arange(starts.shape[0]) < i, lengths(starts, c, duration), 0.0)
    return xp.sum(before) + _length(c[i], t - starts[i])


@in_numpy_or_jit
def inverse(starts: Array, c: Array, duration: Scalar, s: Scalar) -> Scalar:
    """Return the time [s] at which the arc length from the start is `s` [m].

    The result is differentiable where the speed is not zero.
    """
    each = lengths(starts, c, duration)
    before = xp.concatenate([0.0 * each[:1], xp.cumsum(each)])
    i = xp.clip(xp.searchsorted(before, s, side="left") - 1, 0, starts.shape[0] - 1)
    i = xp.minimum(i, xp.sum(xp.isfinite(starts), dtype=i.dtype) - 1)
    piece, h, rest = c[i], pieces.durations(starts, duration)[i], s - before[i]
    fixed = stop_gradient((piece, h, rest))

    def halve(bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bounds
        middle = 0.5 * (low + high)
        is_low = _length(fixed[0], middle) < fixed[2]
        return xp.where(is_low, middle, low), xp.where(is_low, high, middle)

    _, time = repeat(STEPS, halve, (xp.zeros_like(fixed[1]), fixed[1]))
    time = xp.where(fixed[2] <= 0, 0.0, time)
    # Bisection is not differentiable. One final Newton step leaves the value unchanged and supplies the derivatives.
    speed = _speed(fixed[0], time)
    inside = (fixed[2] > 0) & (time < fixed[1]) & (speed > 0)
    error = _length(piece, time) - rest
    change = xp.where(inside, (error - stop_gradient(error)) / xp.where(inside, speed, 1.0), 0.0)
    return starts[i] + time - change


@in_numpy_or_jit
def lengths(starts: Array, c: Array, duration: Scalar) -> Float[Array, " rows"]:
    """Return the length [m] of each segment; the length of padding is zero."""
    return _length(c, pieces.durations(starts, duration))


def _length(c: Float[Array, "*rows terms 3"], h: Array) -> Array:
    """Return the lengths [m] of segments from their starts to the local times `h` (rows) [s]."""
    points, weights = (x.astype(h.dtype) for x in (POINTS, WEIGHTS))
    return h * (_speed(c[..., None, :, :], h[..., None] * points.reshape((1,) * h.ndim + (-1,))) @ weights)


def _speed(c: Float[Array, "*rows terms 3"], s: Array) -> Array:
    return norm(pieces.values(c, s, 1)[1])
