"""Arc lengths by composite Gauss–Legendre quadrature, refined until two refinements agree.

The refinement runs on values alone, without derivatives. The length itself is then a sum over as many panels as that
found, which is differentiated in forward and reverse mode and knows nothing of the search.
"""

from collections.abc import Callable

import equinox.internal as eqxi  # for a loop whose length one batch shares; JAX offers it to nobody else
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from qtraj.foundation.types import Scalar

NODES, PANELS = 16, 32
"""Nodes of a panel, and panels that are worked out at once: a piece. One piece is exact to round-off for a smooth path
whose speed stays clear of zero."""

RUNS, RUN = 32, 64
"""Most pieces, in runs: a million speeds."""

TOLERANCE = 1e-9
"""Relative change at the last refinement, at most; in coarser precisions `ROUNDINGS`."""

ROUNDINGS = 32

LEAST_TOLERANCE = 1e-6
"""A length that a million speeds do not give to this relative change is NaN: never a wrong number."""

Speed = Callable[[Scalar], Scalar]


def arc_length(speed: Speed, duration: Scalar) -> Scalar:
    """∫ speed dt over the duration [m], of a speed at one instant [m/s], in the precision of the duration."""
    pieces, good = _refined(lambda t: jax.lax.stop_gradient(speed(t)), jax.lax.stop_gradient(duration))
    pieces = eqxi.unvmap_max(pieces)  # one number for a whole batch: the loops below stop there

    def piece(k: Int[Array, ""]) -> Scalar:
        return jax.checkpoint(lambda: _piece(speed, duration, k, pieces))()

    def add(total: Scalar, k: Int[Array, ""]) -> tuple[Scalar, None]:
        return jax.lax.cond(k < pieces, lambda: total + piece(k), lambda: total), None

    def add_run(total: Scalar, k: Int[Array, ""]) -> tuple[Scalar, None]:
        within = k * RUN + jnp.arange(RUN, dtype=jnp.int32)
        return jax.lax.cond(k * RUN < pieces, lambda: jax.lax.scan(add, total, within)[0], lambda: total), None

    total, _ = jax.lax.scan(add_run, jnp.zeros((), duration.dtype), jnp.arange(RUNS, dtype=jnp.int32))
    return jnp.where(good, total, jnp.nan)


def _refined(speed: Speed, duration: Scalar) -> tuple[Int[Array, ""], Array]:
    """In how many pieces the length is found, a power of two, and whether it is."""
    tolerance = max(TOLERANCE, ROUNDINGS * float(jnp.finfo(duration.dtype).eps))

    def length(pieces: Int[Array, ""]) -> Scalar:
        start = jnp.zeros((), duration.dtype)
        return jax.lax.fori_loop(0, pieces, lambda k, total: total + _piece(speed, duration, k, pieces), start)

    def agree(state: tuple[Array, Scalar, Scalar], within: float) -> Array:
        _, before, now = state
        return jnp.abs(now - before) <= within * now

    def goes_on(state: tuple[Array, Scalar, Scalar]) -> Array:
        pieces, _, now = state
        possible = (pieces == 0) | (jnp.isfinite(now) & (pieces < RUNS * RUN))
        return possible & ~agree(state, tolerance)

    def refine(state: tuple[Array, Scalar, Scalar]) -> tuple[Array, Scalar, Scalar]:
        pieces, _, now = state
        pieces = jnp.maximum(2 * pieces, 1)
        return pieces, now, length(pieces)

    unknown = jnp.full((), jnp.nan, duration.dtype)
    last = jax.lax.while_loop(goes_on, refine, (jnp.zeros((), jnp.int32), unknown, unknown))
    return last[0], agree(last, max(LEAST_TOLERANCE, tolerance))


def _piece(speed: Speed, duration: Scalar, k: Int[Array, ""], pieces: Int[Array, ""]) -> Scalar:
    """The length of piece `k` of `pieces` equal ones."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    places = ((np.arange(PANELS)[:, None] + (nodes + 1) / 2) / PANELS).ravel()
    part, dtype = duration / pieces.astype(duration.dtype), duration.dtype
    speeds = jax.vmap(speed)(part * (k.astype(dtype) + jnp.asarray(places, dtype)))
    return part * (jnp.asarray(np.tile(weights, PANELS) / (2 * PANELS), dtype) @ speeds)
