"""[−1, 1] in cells, in each of which a function's least value is enclosed; what is undecided is halved.

In a cell the function is a Taylor model. Its quadratic part less the magnitudes of its other coefficients bounds it from
below, and where it is convex, so does the tangent at its minimum: the second bound closes the gap at a minimum, where
the first would need far smaller cells. All of it is fixed work per round, for many paths together; the rounding of
every step is accounted for.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.chebyshev_model import REACH, SLACK, TINY, ChebyshevModel, interpolated

CELLS = 8
"""Cells of a round: a power of two, so that their borders are exact in binary."""

ROUNDS = 24
"""The last cells to be judged are 2⁻²⁶ of the interval wide."""

NEWTON_STEPS = 4

Cells = Float[Array, "cells paths"]
PerPath = Float[Array, " paths"]

Build = Callable[[Cells, Cells], ChebyshevModel]
"""(centres, half widths) → the function in these cells, each of them scaled to [−1, 1]."""


class Enclosure(eqx.Module):
    """In each cell the least value lies in [`low`, `high`]; `high` bounds the value at `at` ∈ [−1, 1]."""

    low: Cells
    high: Cells
    at: Cells


def reach(half: Cells) -> Cells:
    """The long semi-axis of the ellipse on which functions are bounded, in half widths of their cell."""
    return jnp.maximum(REACH, 0.25 / half)


@jax.jit
def minimum(c: Float[Array, "k cells paths"], error: Cells) -> Enclosure:
    """The least value in each cell of functions within `error` of polynomials, enclosed without dividing the cell."""
    eps, count = float(np.finfo(c.dtype).eps), c.shape[0]
    c0, c1, c2 = c[0], c[1], c[2]
    k = jnp.arange(count, dtype=c.dtype)[:, None, None]
    sizes = jnp.abs(c)
    size, steepness = jnp.sum(sizes, axis=0), jnp.sum(k * sizes, axis=0)
    # Below the quadratic c0 − |c1|·x + c2·x², x ∈ [0, 1], there are only the other terms.
    bowl = c2 > 0
    x = jnp.where(bowl, jnp.minimum(jnp.abs(c1) / jnp.where(bowl, 2 * c2, 1.0), 1.0), 1.0)
    others = jnp.sum(jnp.where(k > 2, sizes, 0.0), axis=0)
    low = c0 - x * (jnp.abs(c1) - c2 * x) - others
    slopes = jnp.sum(jnp.where(k > 1, k * sizes, 0.0), axis=0) * SLACK
    monotone, start = jnp.abs(c1) >= slopes, -jnp.sign(c1)
    start = jnp.where(monotone, start, start * x)
    u = jax.lax.fori_loop(0, NEWTON_STEPS, lambda _, u: _newton_step(c, u), start)
    u = jnp.where(monotone, start, u)
    value, slope, _ = _evaluated(c, u)
    rounding = 2 * count * eps * size
    slope_bound = jnp.abs(slope) + 2 * count * eps * steepness
    tangent = value - rounding - slope_bound * (1 + jnp.abs(u)) * SLACK
    convex = 2 * c2 >= jnp.sum(jnp.where(k > 2, k * (k - 1) * sizes, 0.0), axis=0) * SLACK
    error = (error + rounding + (count + 8) * eps * size) * SLACK + TINY
    low = jnp.maximum(low, jnp.where(monotone, value - rounding, jnp.where(convex, tangent, -jnp.inf))) - error
    middle = c0 < value
    high, at = jnp.where(middle, c0, value) + error, jnp.where(middle, 0.0, u)
    # What overflowed is not known: NaN must not pass for a bound.
    return Enclosure(jnp.where(jnp.isnan(low), -jnp.inf, low), jnp.where(jnp.isnan(high), jnp.inf, high), at)


class Front(eqx.Module):
    """The cells that are still undecided, `centre` ± `half` where `active`, and what the others have shown.

    `floor` bounds the function in each cell from below, `low` in all the cells that are done with; `high` is a bound
    on the value `at` the lowest point seen. `open`: more cells were undecided than there is space for.
    """

    centre: Cells
    half: Cells
    floor: Cells
    active: Bool[Array, "cells paths"]
    low: PerPath
    high: PerPath
    at: PerPath
    open: Bool[Array, " paths"]
    round: Int[Array, ""]

    @property
    def undecided(self) -> Bool[Array, " paths"]:
        """Whether there are cells left to judge, and rounds to do it in."""
        return jnp.any(self.active, axis=0) & ~self.open & (self.round < ROUNDS)


def undivided(paths: int, dtype: np.dtype, piece: Array | int = 0, pieces: Array | int = 1) -> Front:
    """The first cells of so many paths, in one of several pieces of [−1, 1]; their number is a power of two."""
    infinite = jnp.full((paths,), jnp.inf, dtype)
    half = 1 / jnp.asarray(CELLS * pieces, dtype)
    centre = (2 * (jnp.arange(CELLS) + CELLS * piece) + 1).astype(dtype) * half - 1
    cells = jnp.broadcast_to(centre[:, None], (CELLS, paths))
    return Front(
        centre=cells,
        half=jnp.broadcast_to(half, (CELLS, paths)),
        floor=jnp.full_like(cells, -jnp.inf),
        active=jnp.ones((CELLS, paths), bool),
        low=infinite,
        high=infinite,
        at=jnp.zeros_like(infinite),
        open=jnp.zeros((paths,), bool),
        round=jnp.asarray(0),
    )


def judged(build: Build, front: Front) -> Front:
    """One round: enclose every cell, and keep those that may hold a value below zero as two halves each."""
    found = minimum(*interpolated(build(front.centre, front.half), reach(front.half)))
    low, high = (jnp.where(front.active, x, jnp.inf) for x in (found.low, found.high))
    lowest = jnp.min(high, axis=0)
    first = jnp.min(jnp.where(high == lowest[None], front.centre + front.half * found.at, 2.0), axis=0)
    better = lowest < front.high
    undecided = front.active & ~(low > 0)
    space = CELLS // 2
    place = jnp.cumsum(undecided, axis=0)
    overfull = place[-1] > space
    chosen = undecided[None] & (place[None] == jnp.arange(1, space + 1)[:, None, None])

    def halves(x: Cells) -> Cells:
        return jnp.tile(jnp.sum(jnp.where(chosen, x[None], 0.0), axis=1), (2, 1))

    half = 0.5 * halves(front.half)
    return Front(
        centre=halves(front.centre) + half * jnp.repeat(jnp.asarray([-1.0, 1.0], half.dtype), space)[:, None],
        half=half,
        floor=halves(low),
        active=jnp.tile(jnp.any(chosen, axis=1), (2, 1)),
        low=jnp.minimum(front.low, jnp.min(jnp.where(undecided & ~overfull[None], jnp.inf, low), axis=0)),
        high=jnp.where(better, lowest, front.high),
        at=jnp.where(better, first, front.at),
        open=front.open | overfull,
        round=front.round + 1,
    )


@jax.jit
def _evaluated(c: Float[Array, "k cells paths"], u: Cells) -> tuple[Cells, Cells, Cells]:
    """Value, slope and half the second derivative, by Horner's rule."""
    value, slope, bend = c[-1], jnp.zeros_like(u), jnp.zeros_like(u)
    for k in reversed(range(c.shape[0] - 1)):
        bend = bend * u + slope
        slope = slope * u + value
        value = value * u + c[k]
    return value, slope, bend


def _newton_step(c: Float[Array, "k cells paths"], u: Cells) -> Cells:
    _, slope, bend = _evaluated(c, u)
    return jnp.clip(u - jnp.where(bend > 0, 0.5 * slope / jnp.where(bend > 0, bend, 1.0), 0.0), -1.0, 1.0)
