"""Compute arc lengths along a route, and the time at a given arc length, by quadrature in each segment.

`starts` (rows,) [s], `c` (rows, terms, 3) and `duration` [s] are the start times, coefficients and duration of a
`Route`. A local time is measured from the start of a segment.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.types import Scalar, Vec3
from qtraj.path import pieces

NODES, PANELS = 12, 8
"""Gauss–Legendre nodes per panel, and panels per segment."""

STEPS = 60
"""Number of bisection steps for the time at a given arc length; the remaining error is round-off."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(NODES)
POINTS = ((np.arange(PANELS)[:, None] + (_NODES + 1) / 2) / PANELS).ravel()
WEIGHTS = np.tile(_WEIGHTS / (2 * PANELS), PANELS)


@jax.jit
def total(starts: Array, c: Array, duration: Scalar) -> Scalar:
    """Return the length [m] of the whole route."""
    return jnp.sum(lengths(starts, c, duration))


@jax.jit
def until(starts: Array, c: Array, duration: Scalar, t: Scalar) -> Scalar:
    """Return the length [m] from the start to the time `t` [s]."""
    i = jnp.maximum(jnp.searchsorted(starts, t, side="right") - 1, 0)
    before = jnp.where(jnp.arange(starts.shape[0], dtype=i.dtype) < i, lengths(starts, c, duration), 0.0)
    return jnp.sum(before) + _length(c[i], t - starts[i])


@jax.jit
def inverse(starts: Array, c: Array, duration: Scalar, s: Scalar) -> Scalar:
    """Return the time [s] at which the arc length from the start is `s` [m].

    The result is differentiable where the speed is not zero.
    """
    each = lengths(starts, c, duration)
    before = jnp.concatenate([jnp.zeros((1,), each.dtype), jnp.cumsum(each)])
    i = jnp.clip(jnp.searchsorted(before, s, side="left") - 1, 0, starts.shape[0] - 1)
    i = jnp.minimum(i, jnp.sum(jnp.isfinite(starts), dtype=i.dtype) - 1)
    piece, h, rest = c[i], pieces.durations(starts, duration)[i], s - before[i]
    fixed = stop_gradient((piece, h, rest))

    def halve(_: Any, bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bounds
        middle = 0.5 * (low + high)
        is_low = _length(fixed[0], middle) < fixed[2]
        return jnp.where(is_low, middle, low), jnp.where(is_low, high, middle)

    _, time = jax.lax.fori_loop(0, STEPS, halve, (jnp.zeros_like(fixed[1]), fixed[1]))
    time = jnp.where(fixed[2] <= 0, 0.0, time)
    # Bisection is not differentiable. One final Newton step leaves the value unchanged and supplies the derivatives.
    speed = _speed(fixed[0], time)
    inside = (fixed[2] > 0) & (time < fixed[1]) & (speed > 0)
    error = _length(piece, time) - rest
    change = jnp.where(inside, (error - stop_gradient(error)) / jnp.where(inside, speed, 1.0), 0.0)
    return starts[i] + time - change


@jax.jit
def lengths(starts: Array, c: Array, duration: Scalar) -> Float[Array, " rows"]:
    """Return the length [m] of each segment; the length of padding is zero."""
    return jax.vmap(_length)(c, pieces.durations(starts, duration))


def _length(c: Float[Array, "terms 3"], h: Scalar) -> Scalar:
    """Return the length [m] of a segment from its start to the local time `h` [s]."""
    points, weights = (jnp.asarray(x, h.dtype) for x in (POINTS, WEIGHTS))
    return h * (weights @ jax.vmap(lambda x: _speed(c, h * x))(points))


def _speed(c: Float[Array, "terms 3"], s: Scalar) -> Scalar:
    velocity: Vec3 = pieces.values(c, s, 1)[1]
    return norm(velocity)
