"""Maxima of a smooth function of time: a grid whose nodes slide onto the maxima.

Every node that is a local maximum of its neighbourhood is moved onto the true maximum by Newton's method, so the
largest value over the nodes is the largest value over the interval, up to maxima narrower than the grid. The moved
times are held constant in differentiation: at a maximum ∂f/∂t = 0, so the gradient of f(t*, x) in x is exact
(envelope theorem); at an end of the interval t* does not move.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar

NEWTON_STEPS = 4


def sliding_nodes(
    f: Callable[[Scalar], Scalar], duration: Scalar, samples: int
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Times and values of `f` on `samples` nodes of [0, duration], local maxima polished by Newton's method.

    The times are constant fractions of the duration to differentiation, since the duration itself may vary.
    """
    step = duration / (samples - 1)
    grid = step * jnp.arange(samples, dtype=duration.dtype)
    values = jax.vmap(f)(grid)
    left = jnp.concatenate([values[:1], values[:-1]])
    right = jnp.concatenate([values[1:], values[-1:]])
    crest = (values >= left) & (values >= right)
    moved = _newton(f, grid, jnp.clip(grid - step, 0.0, duration), jnp.clip(grid + step, 0.0, duration))
    better = crest & (jax.vmap(f)(moved) > values)
    times = jax.lax.stop_gradient(jnp.where(better, moved, grid) / duration) * duration
    return times, jax.vmap(f)(times)


def _newton(
    f: Callable[[Scalar], Scalar], t: Float[Array, " n"], low: Float[Array, " n"], high: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Newton's iteration for f' = 0 on every node at once, kept in its bracket; no step where f is not concave."""

    def slope(t: Scalar) -> Scalar:
        return jax.jvp(f, (t,), (jnp.ones_like(t),))[1]

    def improve(t: Scalar, low: Scalar, high: Scalar) -> Scalar:
        first, second = jax.jvp(slope, (t,), (jnp.ones_like(t),))
        concave = second < 0
        step = jnp.where(concave, -first / jnp.where(concave, second, 1.0), 0.0)
        return jnp.clip(jnp.where(jnp.isfinite(step), t + step, t), low, high)

    def step(_: int, t: Float[Array, " n"]) -> Float[Array, " n"]:
        return jax.vmap(improve)(t, low, high)

    return jax.lax.fori_loop(0, NEWTON_STEPS, step, jax.lax.stop_gradient(t))


def largest(f: Callable[[Scalar], Scalar], duration: Scalar, samples: int) -> tuple[Scalar, Scalar]:
    """Time and value of the largest `f` over [0, duration]; the value is differentiable (envelope theorem)."""
    times, values = sliding_nodes(f, duration, samples)
    worst = jnp.argmax(values)
    return times[worst], values[worst]
