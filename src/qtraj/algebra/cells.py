"""[−1, 1] in cells, in each of which a function's least value is enclosed; what is undecided is halved.

In a cell the function is a polynomial and an error. Its least Bernstein coefficient bounds it from below, and where it
is convex, so does the tangent at its minimum: that closes the gap there, where the first would need far smaller cells.
All of it is fixed work per round, for many paths together; the rounding of every step is accounted for.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.algebra.chebyshev_model import LONGEST, REACHES, SLACK, TINY, ChebyshevModel, interpolated

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


def semi_axes(half: Cells) -> Float[Array, "ellipses cells paths"]:
    """The long semi-axes of the ellipses on which functions are bounded, in half widths of their cell.

    The largest serves in the long run; functions that vary much in a cell ask for a small one.
    """
    fixed = [jnp.full_like(half, x) for x in REACHES]
    return jnp.stack([*fixed, jnp.maximum(LONGEST, 0.25 / half)])


@jax.jit
def enclose_minimum(c: Float[Array, "k cells paths"], error: Cells) -> Enclosure:
    """The least value in each cell of functions within `error` of polynomials, enclosed without dividing the cell."""
    eps, count = float(np.finfo(c.dtype).eps), c.shape[0]
    size = jnp.sum(jnp.abs(c), axis=0)
    steepness = jnp.sum(jnp.arange(count, dtype=c.dtype)[:, None, None] * jnp.abs(c), axis=0)
    rounding = (count + 8) * eps * size
    b = jnp.tensordot(jnp.asarray(_to_bernstein(count), c.dtype), c, 1, precision="highest")
    steps = b[1:] - b[:-1]
    convex = jnp.min(steps[1:] - steps[:-1], axis=0, initial=jnp.inf) >= 4 * rounding
    rises = jnp.min(steps, axis=0, initial=jnp.inf) >= 2 * rounding
    falls = jnp.max(steps, axis=0, initial=-jnp.inf) <= -2 * rounding
    u = jax.lax.fori_loop(0, NEWTON_STEPS, lambda _, u: _newton_step(c, u), _vertex(c))
    u = jnp.where(rises, -1.0, jnp.where(falls, 1.0, u))
    value, slope, _ = _evaluated(c, u)
    tangent = value - rounding - (jnp.abs(slope) + 2 * count * eps * steepness) * (1 + jnp.abs(u)) * SLACK
    below = jnp.where(rises | falls, value, jnp.where(convex, tangent, -jnp.inf))
    error = (error + 3 * rounding) * SLACK + TINY
    low = jnp.maximum(jnp.min(b, axis=0), below) - error
    middle = c[0] < value
    high, at = jnp.where(middle, c[0], value) + error, jnp.where(middle, 0.0, u)
    # What overflowed is not known: NaN must not pass for a bound.
    return Enclosure(jnp.where(jnp.isnan(low), -jnp.inf, low), jnp.where(jnp.isnan(high), jnp.inf, high), at)


def _to_bernstein(count: int) -> np.ndarray:
    """From coefficients of powers on [−1, 1] to those of the Bernstein polynomials; none exceeds 1."""
    n = count - 1

    def entry(j: int, k: int) -> float:
        whole = sum((-1) ** (k - i) * math.comb(j, i) * math.comb(n - j, k - i) for i in range(k + 1))
        return whole / math.comb(n, k)

    return np.array([[entry(j, k) for k in range(count)] for j in range(count)])


def _vertex(c: Float[Array, "k cells paths"]) -> Cells:
    """Where the quadratic part is least on [−1, 1]."""
    bowl, steep = c[2] > 0, jnp.abs(c[1])
    return -jnp.sign(c[1]) * jnp.where(bowl, jnp.minimum(steep / jnp.where(bowl, 2 * c[2], 1.0), 1.0), 1.0)


class Front(eqx.Module):
    """The cells that are still undecided, `centre` ± `half` where `active`, and what the others have shown.

    `floor` bounds the function in each cell from below, `low` in all the cells that are done with; `high` is a bound
    on the value `at` the lowest point seen. `overfull`: more cells were undecided than there is space for.
    """

    centre: Cells
    half: Cells
    floor: Cells
    active: Bool[Array, "cells paths"]
    low: PerPath
    high: PerPath
    at: PerPath
    overfull: Bool[Array, " paths"]

    @property
    def undecided(self) -> Bool[Array, " paths"]:
        """Whether there are cells left to judge."""
        return jnp.any(self.active & (self.half > FINEST), axis=0) & ~self.overfull


def initial_front(left: PerPath, width: PerPath, going: Bool[Array, " paths"]) -> Front:
    """The first cells of pieces of [−1, 1] that begin at `left`; none where a path is not `going` on."""
    infinite = jnp.full_like(left, jnp.inf)
    half = jnp.broadcast_to(width[None] / (2 * CELLS), (CELLS, *width.shape))
    centre = left[None] + half * jnp.arange(1, 2 * CELLS, 2, dtype=left.dtype)[:, None]
    return Front(
        centre=centre,
        half=half,
        floor=jnp.full_like(centre, -jnp.inf),
        active=jnp.broadcast_to(going[None], centre.shape),
        low=infinite,
        high=infinite,
        at=jnp.zeros_like(infinite),
        overfull=jnp.zeros_like(going),
    )


def refine(build: Build, front: Front) -> Front:
    """One round: enclose every cell, and divide those that may hold a value below zero.

    One cell is divided into all that there is space for, four of them into halves.
    """
    found = enclose_minimum(*interpolated(build(front.centre, front.half), semi_axes(front.half)))
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
        overfull=front.overfull | overfull,
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
