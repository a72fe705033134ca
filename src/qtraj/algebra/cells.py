"""[0, 1] in cells, in each of which a polynomial's least value is enclosed; what is undecided is halved.

In a cell the least Bernstein coefficient bounds the polynomial from below, and where it is convex, so does the tangent
at its minimum: the second bound closes the gap at a minimum, where the first would need cells as small as the square
root of the gap. All of it is fixed work per round, so it can be jitted and vmapped; the rounding of every step is
accounted for.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.bernstein import Bernstein
from qtraj.foundation.types import Flag, Scalar, ScalarLike

CELLS = 8
"""Cells of a round: a power of two, so that their borders are exact in binary."""

ROUNDS = 24
"""The last cells to be judged are 2⁻²⁶ wide."""

NEWTON_STEPS = 4

Build = Callable[[Any, Scalar, Scalar], Bernstein]
"""(parts, low, high) → the polynomial on that part of [0, 1], in the form of that interval."""


class Enclosure(eqx.Module):
    """The least value of one polynomial lies in [`low`, `high`]; `high` bounds the value at `at` ∈ [0, 1]."""

    low: Scalar
    high: Scalar
    at: Scalar


def minimum(p: Bernstein) -> Enclosure:
    """The least value of a polynomial on [0, 1], enclosed without dividing the interval."""
    u = _stationary(p)
    inside, rounding = p.at(u)
    values = jnp.stack([p.coefficients[0], p.coefficients[-1], inside])
    where = jnp.stack([jnp.zeros_like(u), jnp.ones_like(u), u])
    best = jnp.argmin(values)
    low = jnp.min(p.coefficients) - p.error
    low = jnp.maximum(low, jnp.where(_convex(p), _tangent_bound(p, u), -jnp.inf))
    high = values[best] + rounding
    # What overflowed is not known: NaN must not pass for a bound.
    return Enclosure(jnp.where(jnp.isnan(low), -jnp.inf, low), jnp.where(jnp.isnan(high), jnp.inf, high), where[best])


class Front(eqx.Module):
    """The cells that are still undecided, [`start`, `start` + `width`] where `active`, and what the others have shown.

    `floor` bounds the polynomial in each cell from below, `low` in all the cells that are done with; `high` is a bound
    on the value `at` the lowest point seen. `open`: more cells were undecided than there is room for.
    """

    start: Float[Array, " cells"]
    width: Float[Array, " cells"]
    floor: Float[Array, " cells"]
    active: Bool[Array, " cells"]
    low: Scalar
    high: Scalar
    at: Scalar
    open: Flag
    round: Int[Array, ""]

    @property
    def undecided(self) -> Flag:
        """Whether there are cells left to judge, and rounds to do it in."""
        return jnp.any(self.active) & ~self.open & (self.round < ROUNDS)

    @property
    def floor_of_all(self) -> Scalar:
        """A bound from below on the whole interval."""
        return jnp.minimum(self.low, jnp.min(jnp.where(self.active, self.floor, jnp.inf)))


def undivided(build: Build, parts: Any) -> Front:
    end = jnp.asarray(1.0)
    dtype = jax.eval_shape(lambda: build(parts, end, end)).error.dtype
    nothing = jnp.asarray(jnp.inf, dtype)
    return Front(
        start=jnp.arange(CELLS, dtype=dtype) / CELLS,
        width=jnp.full((CELLS,), 1 / CELLS, dtype),
        floor=jnp.full((CELLS,), -jnp.inf, dtype),
        active=jnp.ones((CELLS,), bool),
        low=nothing,
        high=nothing,
        at=jnp.zeros_like(nothing),
        open=jnp.asarray(False),
        round=jnp.asarray(0),
    )


def judged(build: Build, parts: Any, front: Front, enough: Callable[[Scalar], Scalar]) -> Front:
    """One round: enclose every cell, and keep what is undecided as two halves each.

    A cell is decided where its polynomial is above `enough(high)`, `high` bounding the lowest value seen.
    """
    found = jax.vmap(lambda start, width: minimum(build(parts, start, start + width)))(front.start, front.width)
    low, high = (jnp.where(front.active, x, jnp.inf) for x in (found.low, found.high))
    best = jnp.argmin(high)
    better = high[best] < front.high
    lowest = jnp.where(better, high[best], front.high)
    undecided = front.active & ~(low > enough(lowest))
    room = front.start.shape[0] // 2
    order = jnp.argsort(jnp.where(undecided, low, jnp.inf))[:room]  # the lowest first
    start, half = front.start[order], 0.5 * front.width[order]
    overfull = jnp.sum(undecided) > room
    return Front(
        start=jnp.concatenate([start, start + half]),
        width=jnp.tile(half, 2),
        floor=jnp.tile(low[order], 2),
        active=jnp.tile(undecided[order], 2),
        low=jnp.minimum(front.low, jnp.min(jnp.where(undecided & ~overfull, jnp.inf, low))),
        high=lowest,
        at=jnp.where(better, front.start[best] + front.width[best] * found.at[best], front.at),
        open=overfull,
        round=front.round + 1,
    )


def _stationary(p: Bernstein) -> Scalar:
    """Where a convex polynomial is least in [0, 1], by Newton's method from its lowest coefficient."""
    first = p.derivative()
    second = first.derivative()
    start = jnp.argmin(p.coefficients).astype(p.coefficients.dtype) / max(p.degree, 1)

    def step(_: ScalarLike, u: Scalar) -> Scalar:
        slope, bend = first.at(u)[0], second.at(u)[0]
        move = jnp.where(bend > 0, slope / jnp.where(bend > 0, bend, 1.0), 0.0)
        return jnp.clip(u - move, 0.0, 1.0)

    return jax.lax.fori_loop(0, NEWTON_STEPS, step, start)


def _convex(p: Bernstein) -> Flag:
    second = p.derivative().derivative()
    return jnp.min(second.coefficients) - second.error >= 0


def _tangent_bound(p: Bernstein, u: Scalar) -> Scalar:
    """p(u) − |p'(u)| max(u, 1−u): below a convex polynomial on all of [0, 1]."""
    value, rounding = p.at(u)
    slope, slope_rounding = p.derivative().at(u)
    return value - rounding - (jnp.abs(slope) + slope_rounding) * jnp.maximum(u, 1 - u) * (1 + 2.0**-40)
