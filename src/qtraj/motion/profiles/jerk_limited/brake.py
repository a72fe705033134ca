"""Return an initial state to the limits on acceleration and rate.

An acceleration beyond its limit is reduced at the jerk limit. A rate that is beyond its limit, or that the
acceleration would carry beyond it, is then reduced as fast as possible until it is at its limit, unless it would later
exceed the opposite limit.
"""

from typing import NamedTuple

from jaxtyping import Array, Float

from qtraj.foundation.namespace import xp
from qtraj.foundation.types import Scalar


class Brake(NamedTuple):
    """The times of the three segments, their jerks, and the state after them, for jerk and acceleration limits of 1."""

    widths: Float[Array, "3"]
    jerks: Float[Array, "3"]
    distance: Scalar
    rate: Scalar
    acceleration: Scalar


def brake(v: Scalar, a: Scalar, max_rate: Scalar | None) -> Brake:
    """Return the braking from the rate v and the acceleration a; its times are zero for a state within the limits."""
    zero = xp.zeros_like(v)
    sense = xp.where(a > 0, -1.0, 1.0).astype(v.dtype)
    first = xp.where(abs(a) > 1, abs(a) - 1, 0.0)
    x, v, a = _after(zero, v, a, sense, first)
    jerks, widths = [sense, zero, zero], [first, zero, zero]
    if max_rate is not None:
        down = ((v > max_rate) & (v - a**2 / 2 > -max_rate)) | ((a > 0) & (v + a**2 / 2 > max_rate))
        up = ((v < -max_rate) & (v + a**2 / 2 < max_rate)) | ((a < 0) & (v - a**2 / 2 < -max_rate))
        side = xp.where(down, 1.0, xp.where(up, -1.0, 0.0)).astype(v.dtype)
        ramp, hold = _to_limit(side * v, side * a, max_rate)
        ramp, hold = (xp.where(side == 0, 0.0, t) for t in (ramp, hold))
        x, v, a = _after(x, v, a, -side, ramp)
        x, v, a = _after(x, v, a, zero, hold)
        jerks, widths = [sense, -side, zero], [first, ramp, hold]
    return Brake(xp.stack(widths), xp.stack(jerks), x, v, a)


def _to_limit(v: Scalar, a: Scalar, max_rate: Scalar) -> tuple[Scalar, Scalar]:
    """Return the times of decreasing and of lowest acceleration until the rate is `max_rate`.

    The braking ends before, where the acceleration can still vanish at the rate −`max_rate`.
    """
    to_upper, to_lower = a + _root(a**2 + 2 * (v - max_rate)), a + _root(a**2 / 2 + v + max_rate)
    ramp = xp.minimum(xp.minimum(to_upper, to_lower), a + 1)
    reached = v + (a**2 - 1) / 2
    hold = xp.minimum(reached - max_rate, reached + max_rate - 0.5)
    return xp.maximum(ramp, 0.0), xp.where(ramp < a + 1, 0.0, xp.maximum(hold, 0.0))


def _after(x: Scalar, v: Scalar, a: Scalar, j: Scalar, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Return distance, rate and acceleration after the time t at the jerk j."""
    return x + t * (v + t * (a / 2 + t * (j / 6))), v + t * (a + t * (j / 2)), a + j * t


def _root(x: Scalar) -> Scalar:
    """Return √x, or 0 with zero gradient for x ≤ 0."""
    positive = x > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, x, 1.0)), 0.0)
