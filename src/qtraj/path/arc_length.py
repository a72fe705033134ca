"""Compute arc lengths by composite Gauss–Legendre quadrature, refined until two successive results agree.

The refinement determines the number of subintervals and is not differentiated. The length, a sum over these
subintervals, is differentiable in forward and reverse mode.
"""

from collections.abc import Callable
from typing import Any

import equinox.internal as eqxi  # for `unvmap_max`, which JAX does not provide
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.namespace import is_host
from qtraj.foundation.types import Scalar

NODES, PANELS = 16, 32
"""Nodes per panel, and panels per subinterval.

The panels of a subinterval are evaluated together. For a smooth path whose speed is not near zero, the length computed
with one subinterval is exact to round-off.
"""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(NODES)
PLACES = ((np.arange(PANELS)[:, None] + (_NODES + 1) / 2) / PANELS).ravel()
WEIGHTS = np.tile(_WEIGHTS, PANELS) / (2 * PANELS)
"""The nodes of a subinterval of length 1, and their weights."""

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

Speed = Callable[[Float[Array, " n"]], Float[Array, " n"]]
"""A function that returns the speeds [m/s] at several instants [s]."""


def arc_length(speed: Speed, duration: Scalar) -> Scalar:
    """Return ∫ speed dt [m] over the `duration` [s], in the precision of the duration."""
    if is_host(duration):
        return _refined(speed, duration)
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


def _refined(speed: Speed, duration: Any) -> Any:
    """Return the length computed in NumPy, with the same refinement as `_refine`."""
    pieces, previous, current = 0, np.nan, np.nan
    while not abs(current - previous) <= TOLERANCE * current:
        if pieces and not (np.isfinite(current) and pieces < MAX_RUNS * RUN):
            break
        pieces = max(2 * pieces, 1)
        previous, current = (
            current,
            sum(_piece(speed, duration, np.float64(k), np.float64(pieces)) for k in range(pieces)),
        )
    return current if abs(current - previous) <= MAX_CHANGE * current else np.float64(np.nan)


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


def _piece(speed: Speed, duration: Any, k: Any, pieces: Any) -> Any:
    """Return the length of subinterval `k` of `pieces` subintervals of equal duration."""
    part, dtype = duration / pieces.astype(duration.dtype), duration.dtype
    speeds = speed(part * (k.astype(dtype) + PLACES.astype(dtype)))
    return part * (WEIGHTS.astype(dtype) @ speeds)
