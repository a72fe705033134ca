"""Arc length along a route, and the time at which a length is covered, by quadrature in each segment."""

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
"""Gauss–Legendre nodes of a panel, and panels of a segment."""

STEPS = 60
"""Bisections that find the time of a length: to round-off."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(NODES)
PLACES = ((np.arange(PANELS)[:, None] + (_POINTS + 1) / 2) / PANELS).ravel()
WEIGHTS = np.tile(_WEIGHTS / (2 * PANELS), PANELS)


@jax.jit
def total(starts: Array, c: Array, duration: Scalar) -> Scalar:
    """The length of the whole route [m]."""
    return jnp.sum(lengths(starts, c, duration))


@jax.jit
def until(starts: Array, c: Array, duration: Scalar, t: Scalar) -> Scalar:
    """The length from the start to `t` [m]."""
    i = jnp.maximum(jnp.searchsorted(starts, t, side="right") - 1, 0)
    before = jnp.where(jnp.arange(starts.shape[0], dtype=i.dtype) < i, lengths(starts, c, duration), 0.0)
    return jnp.sum(before) + _length(c[i], t - starts[i])


@jax.jit
def inverse(starts: Array, c: Array, duration: Scalar, s: Scalar) -> Scalar:
    """The time at which the length `s` is covered; differentiable where the route moves."""
    each = lengths(starts, c, duration)
    covered = jnp.concatenate([jnp.zeros((1,), each.dtype), jnp.cumsum(each)])
    i = jnp.clip(jnp.searchsorted(covered, s, side="left") - 1, 0, starts.shape[0] - 1)
    i = jnp.minimum(i, jnp.sum(jnp.isfinite(starts), dtype=i.dtype) - 1)
    piece, h, rest = c[i], pieces.durations(starts, duration)[i], s - covered[i]
    fixed = stop_gradient((piece, h, rest))

    def halve(_: Any, bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bounds
        middle = 0.5 * (low + high)
        short = _length(fixed[0], middle) < fixed[2]
        return jnp.where(short, middle, low), jnp.where(short, high, middle)

    _, found = jax.lax.fori_loop(0, STEPS, halve, (jnp.zeros_like(fixed[1]), fixed[1]))
    found = jnp.where(fixed[2] <= 0, 0.0, found)
    # The value is known; a step of Newton's method that does not move it has the derivatives.
    speed = _speed(fixed[0], found)
    inside = (fixed[2] > 0) & (found < fixed[1]) & (speed > 0)
    missing = _length(piece, found) - rest
    change = jnp.where(inside, (missing - stop_gradient(missing)) / jnp.where(inside, speed, 1.0), 0.0)
    return starts[i] + found - change


@jax.jit
def lengths(starts: Array, c: Array, duration: Scalar) -> Float[Array, " rows"]:
    """The length of each segment [m]; zero for those of the padding."""
    return jax.vmap(_length)(c, pieces.durations(starts, duration))


def _length(c: Float[Array, "terms 3"], h: Scalar) -> Scalar:
    """The length of a segment from its start to the local time `h`."""
    places, weights = (jnp.asarray(x, h.dtype) for x in (PLACES, WEIGHTS))
    return h * (weights @ jax.vmap(lambda x: _speed(c, h * x))(places))


def _speed(c: Float[Array, "terms 3"], s: Scalar) -> Scalar:
    velocity: Vec3 = pieces.values(c, s, 1)[1]
    return norm(velocity)
