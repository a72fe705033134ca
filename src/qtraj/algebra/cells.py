"""[−1, 1] in cells, in each of which a function's least value is enclosed; what is undecided is halved.

In a cell the function is a polynomial and an error. Its quadratic part less the magnitudes of its other coefficients
bounds it from below, and where it is convex, so does the tangent at its minimum: the second bound closes the gap at a
minimum, where the first would need far smaller cells. All of it is fixed work per round, for many paths together; the
rounding of every step is accounted for.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.algebra.chebyshev_model import REACH, SLACK, TINY, ChebyshevModel, interpolated

CELLS = 8
"""Cells of a round: a power of two, so that their borders are exact in binary."""

FINEST = 2.0**-26
"""Of the interval: what is undecided in cells so narrow, or narrower, stays open."""

NEWTON_STEPS = 3

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
    k = jnp.arange(count, dtype=c.dtype)[:, None, None]
    sizes, slopes, bends = jnp.abs(c), k * c, (k * (k - 1)) * c
    size, steepness = jnp.sum(sizes, axis=0), jnp.sum(jnp.abs(slopes), axis=0)
    low, start = _below(c)
    sign = jnp.where(c[1] < 0, -1.0, 1.0)
    monotone = _below(sign[None] * slopes[1:])[0] >= (1 - 1 / SLACK) * steepness
    convex = _below(bends[2:])[0] >= (1 - 1 / SLACK) * jnp.sum(jnp.abs(bends), axis=0)
    u = jax.lax.fori_loop(0, NEWTON_STEPS, lambda _, u: _newton_step(c, u), start)
    u = jnp.where(monotone, -sign, u)
    value, slope, _ = _evaluated(c, u)
    rounding = 2 * count * eps * size
    slope_bound = jnp.abs(slope) + 2 * count * eps * steepness
    tangent = value - rounding - slope_bound * (1 + jnp.abs(u)) * SLACK
    error = (error + rounding + (count + 8) * eps * size) * SLACK + TINY
    low = jnp.maximum(low, jnp.where(monotone, value - rounding, jnp.where(convex, tangent, -jnp.inf))) - error
    middle = c[0] < value
    high, at = jnp.where(middle, c[0], value) + error, jnp.where(middle, 0.0, u)
    # What overflowed is not known: NaN must not pass for a bound.
    return Enclosure(jnp.where(jnp.isnan(low), -jnp.inf, low), jnp.where(jnp.isnan(high), jnp.inf, high), at)


@jax.jit
def _below(c: Float[Array, "k cells paths"]) -> tuple[Cells, Cells]:
    """The least of the quadratic part on [−1, 1], less the magnitudes of all other coefficients; and its place."""
    bowl, steep = c[2] > 0, jnp.abs(c[1])
    x = jnp.where(bowl, jnp.minimum(steep / jnp.where(bowl, 2 * c[2], 1.0), 1.0), 1.0)
    return c[0] - x * (steep - c[2] * x) - jnp.sum(jnp.abs(c[3:]), axis=0), -jnp.sign(c[1]) * x


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

    @property
    def undecided(self) -> Bool[Array, " paths"]:
        """Whether there are cells left to judge."""
        return jnp.any(self.active & (self.half > FINEST), axis=0) & ~self.open


def undivided(paths: int, dtype: np.dtype, piece: Array | int = 0, pieces: Array | int = 1) -> Front:
    """The first cells of so many paths, in one of several pieces of [−1, 1]; their number is a power of two."""
    infinite = jnp.full((paths,), jnp.inf, dtype)
    half = 1 / jnp.asarray(CELLS * pieces, dtype)
    centre = (2 * (jnp.arange(CELLS, dtype=jnp.int32) + CELLS * piece) + 1).astype(dtype) * half - 1
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
    )


def judged(build: Build, front: Front) -> Front:
    """One round: enclose every cell, and divide those that may hold a value below zero.

    One cell is divided into all that there is space for, four of them into halves.
    """
    found = minimum(*interpolated(build(front.centre, front.half), reach(front.half)))
    low, high = (jnp.where(front.active, x, jnp.inf) for x in (found.low, found.high))
    lowest = jnp.min(high, axis=0)
    first = jnp.min(jnp.where(high == lowest[None], front.centre + front.half * found.at, 2.0), axis=0)
    better = lowest < front.high
    undecided = front.active & ~(low > 0)
    place = jnp.cumsum(undecided, axis=0)
    number = place[-1]
    parts = jnp.where(number == 1, CELLS, jnp.where(number == 2, CELLS // 2, CELLS // 4)).astype(place.dtype)[None]
    cell = jnp.arange(CELLS, dtype=place.dtype)[:, None]
    source = cell // parts
    chosen = undecided[None] & (place[None] == source[:, None] + 1)
    overfull = number > CELLS // 2

    def divided(x: Cells) -> Cells:
        return jnp.sum(jnp.where(chosen, x[None], 0.0), axis=1)

    half = divided(front.half)
    offset = (2 * (cell - source * parts) + 1 - parts).astype(half.dtype)
    smaller = half / parts.astype(half.dtype)
    return Front(
        centre=divided(front.centre) + smaller * offset,
        half=smaller,
        floor=divided(low),
        active=jnp.any(chosen, axis=1),
        low=jnp.minimum(front.low, jnp.min(jnp.where(undecided & ~overfull[None], jnp.inf, low), axis=0)),
        high=jnp.where(better, lowest, front.high),
        at=jnp.where(better, first, front.at),
        open=front.open | overfull,
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
