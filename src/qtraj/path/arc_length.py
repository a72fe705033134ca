"""Compute arc lengths by composite Gauss–Legendre quadrature, refined until two successive results agree.

The refinement determines the number of subintervals and is not differentiated. The length, a sum over these
subintervals, is differentiable in forward and reverse mode.
"""

from collections.abc import Callable

import equinox.internal as eqxi  # for `unvmap_max`, which JAX does not provide
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from qtraj.foundation.types import Scalar

NODES, PANELS = 16, 32
"""Nodes per panel, and panels per subinterval.

The panels of a subinterval are evaluated together. For a smooth path whose speed is not near zero, the length computed
with one subinterval is exact to round-off.
"""

MAX_RUNS, RUN = 32, 64
"""Maximum number of runs in which the subintervals are summed, and number of subintervals in a run.

An estimate of the length therefore uses at most about a million evaluations of the speed.
"""

TOLERANCE = 1e-9
"""The refinement ends if the relative change of the length is at most `TOLERANCE` or `ROUNDINGS` machine epsilons."""

ROUNDINGS = 32

MAX_CHANGE = 1e-6
"""Maximum relative change after a million evaluations; if the change is larger, the length is NaN.

In float32, the maximum is `ROUNDINGS` machine epsilons (4e-6) instead.
"""

Speed = Callable[[Scalar], Scalar]


def arc_length(speed: Speed, duration: Scalar) -> Scalar:
    """Return ∫ speed dt [m] over the `duration` [s], in the precision of the duration; `speed(t)` is in m/s."""
    pieces, converged = _refine(lambda t: jax.lax.stop_gradient(speed(t)), jax.lax.stop_gradient(duration))
    pieces = eqxi.unvmap_max(pieces)  # one number for the whole batch, so that the loops below can stop early

    def piece(k: Int[Array, ""]) -> Scalar:
        return jax.checkpoint(lambda: _piece(speed, duration, k, pieces))()

    def add(total: Scalar, k: Int[Array, ""]) -> tuple[Scalar, None]:
        return jax.lax.cond(k < pieces, lambda: total + piece(k), lambda: total), None

    def add_run(total: Scalar, k: Int[Array, ""]) -> tuple[Scalar, None]:
        within = k * RUN + jnp.arange(RUN, dtype=jnp.int32)
        return jax.lax.cond(k * RUN < pieces, lambda: jax.lax.scan(add, total, within)[0], lambda: total), None

    total, _ = jax.lax.scan(add_run, jnp.zeros((), duration.dtype), jnp.arange(MAX_RUNS, dtype=jnp.int32))
    return jnp.where(converged, total, jnp.nan)


def _refine(speed: Speed, duration: Scalar) -> tuple[Int[Array, ""], Array]:
    """Return the number of subintervals, a power of two, and whether the refinement converged."""
    tolerance = max(TOLERANCE, ROUNDINGS * float(jnp.finfo(duration.dtype).eps))

    def length(pieces: Int[Array, ""]) -> Scalar:
        start = jnp.zeros((), duration.dtype)
        return jax.lax.fori_loop(0, pieces, lambda k, total: total + _piece(speed, duration, k, pieces), start)

    def agree(state: tuple[Array, Scalar, Scalar], tolerance: float) -> Array:
        _, previous, current = state
        return jnp.abs(current - previous) <= tolerance * current

    def continues(state: tuple[Array, Scalar, Scalar]) -> Array:
        pieces, _, current = state
        possible = (pieces == 0) | (jnp.isfinite(current) & (pieces < MAX_RUNS * RUN))
        return possible & ~agree(state, tolerance)

    def refine(state: tuple[Array, Scalar, Scalar]) -> tuple[Array, Scalar, Scalar]:
        pieces, _, current = state
        pieces = jnp.maximum(2 * pieces, 1)
        return pieces, current, length(pieces)

    unknown = jnp.full((), jnp.nan, duration.dtype)
    last = jax.lax.while_loop(continues, refine, (jnp.zeros((), jnp.int32), unknown, unknown))
    return last[0], agree(last, max(MAX_CHANGE, tolerance))


def _piece(speed: Speed, duration: Scalar, k: Int[Array, ""], pieces: Int[Array, ""]) -> Scalar:
    """Return the length of subinterval `k` of `pieces` subintervals of equal duration."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    places = ((np.arange(PANELS)[:, None] + (nodes + 1) / 2) / PANELS).ravel()
    part, dtype = duration / pieces.astype(duration.dtype), duration.dtype
    speeds = jax.vmap(speed)(part * (k.astype(dtype) + jnp.asarray(places, dtype)))
    return part * (jnp.asarray(np.tile(weights, PANELS) / (2 * PANELS), dtype) @ speeds)
