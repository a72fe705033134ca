"""Branch and bound on [−1, 1]: enclose the minimum of a function in cells, and subdivide the undecided cells.

In a cell the function is a polynomial plus a bounded error. The smallest Bernstein coefficient is a lower bound. Where
the polynomial is convex, the tangent at its minimum is a second lower bound; it is much tighter there, so cells need
not become very small. Each round does a fixed amount of work for many paths together. The bounds include all rounding
errors.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.algebra.chebyshev_model import MIN_LAST_SEMI_AXIS, SEMI_AXES, SLACK, TINY, ChebyshevModel, interpolated
from qtraj.algebra.polynomial import taylor_terms

CELLS = 8
"""Number of cells in a round: a power of two, so that their limits are exact in binary."""

MIN_HALF_WIDTH = 2.0**-26
"""Undecided cells of this half width or less are not subdivided further."""

NEWTON_STEPS = 3

Cells = Float[Array, "cells paths"]
PerPath = Float[Array, " paths"]

Build = Callable[[Cells, Cells], ChebyshevModel]
"""(centres, half widths) → the function in these cells, each scaled to [−1, 1]."""


class Enclosure(eqx.Module):
    """Bounds on the minimum in each cell: it lies in [`low`, `high`], and the value at `at` ∈ [−1, 1] is ≤ `high`."""

    low: Cells
    high: Cells
    at: Cells


def semi_axes(half: Cells) -> Float[Array, "ellipses cells paths"]:
    """The semi-major axes of the ellipses on which functions are bounded, in half widths of their cell.

    The largest ellipse gives the best bound in small cells; a small one is better where a function varies much.
    """
    fixed = [jnp.full_like(half, x) for x in SEMI_AXES]
    return jnp.stack([*fixed, jnp.maximum(MIN_LAST_SEMI_AXIS, 0.25 / half)])


@jax.jit
def enclose_minimum(c: Float[Array, "k cells paths"], error: Cells) -> Enclosure:
    """Bounds on the minimum in each cell of functions within `error` of the polynomials with coefficients `c`."""
    eps, count = float(np.finfo(c.dtype).eps), c.shape[0]
    size = jnp.sum(jnp.abs(c), axis=0)
    steepness = jnp.sum(jnp.arange(count, dtype=c.dtype)[:, None, None] * jnp.abs(c), axis=0)
    rounding = (count + 8) * eps * size
    b = jnp.tensordot(jnp.asarray(_to_bernstein(count), c.dtype), c, 1, precision="highest")
    steps = b[1:] - b[:-1]
    convex = jnp.min(steps[1:] - steps[:-1], axis=0, initial=jnp.inf) >= 4 * rounding
    rises = jnp.min(steps, axis=0, initial=jnp.inf) >= 2 * rounding
    falls = jnp.max(steps, axis=0, initial=-jnp.inf) <= -2 * rounding
    u = jax.lax.fori_loop(0, NEWTON_STEPS, lambda _, u: _newton_step(c, u), _quadratic_minimum(c))
    u = jnp.where(rises, -1.0, jnp.where(falls, 1.0, u))
    value, slope, _ = _evaluate(c, u)
    tangent = value - rounding - (jnp.abs(slope) + 2 * count * eps * steepness) * (1 + jnp.abs(u)) * SLACK
    below = jnp.where(rises | falls, value, jnp.where(convex, tangent, -jnp.inf))
    error = (error + 3 * rounding) * SLACK + TINY
    low = jnp.maximum(jnp.min(b, axis=0), below) - error
    centre_is_lower = c[0] < value
    high, at = jnp.where(centre_is_lower, c[0], value) + error, jnp.where(centre_is_lower, 0.0, u)
    # After an overflow there is no bound: NaN must not count as one.
    return Enclosure(jnp.where(jnp.isnan(low), -jnp.inf, low), jnp.where(jnp.isnan(high), jnp.inf, high), at)


def _to_bernstein(count: int) -> np.ndarray:
    """The matrix from power coefficients on [−1, 1] to Bernstein coefficients; no entry exceeds 1."""
    n = count - 1

    def entry(j: int, k: int) -> float:
        numerator = sum((-1) ** (k - i) * math.comb(j, i) * math.comb(n - j, k - i) for i in range(k + 1))
        return numerator / math.comb(n, k)

    return np.array([[entry(j, k) for k in range(count)] for j in range(count)])


def _quadratic_minimum(c: Float[Array, "k cells paths"]) -> Cells:
    """The minimum point on [−1, 1] of the quadratic part."""
    convex, slope = c[2] > 0, jnp.abs(c[1])
    return -jnp.sign(c[1]) * jnp.where(convex, jnp.minimum(slope / jnp.where(convex, 2 * c[2], 1.0), 1.0), 1.0)


class Front(eqx.Module):
    """The state of the search: undecided cells, `centre` ± `half` where `active`, and bounds from the decided cells.

    `lower_bound` bounds the function from below in each active cell, and `low` in all decided cells. The value at the
    lowest point evaluated, `at`, is at most `high`. `overfull` is true if there were more undecided cells than array
    elements.
    """

    centre: Cells
    half: Cells
    lower_bound: Cells
    active: Bool[Array, "cells paths"]
    low: PerPath
    high: PerPath
    at: PerPath
    overfull: Bool[Array, " paths"]

    @property
    def undecided(self) -> Bool[Array, " paths"]:
        """Whether there are cells left to subdivide."""
        return jnp.any(self.active & (self.half > MIN_HALF_WIDTH), axis=0) & ~self.overfull


def initial_front(left: PerPath, width: PerPath, active: Bool[Array, " paths"]) -> Front:
    """The first cells of the pieces [left, left + width] of [−1, 1], for the `active` paths."""
    infinite = jnp.full_like(left, jnp.inf)
    half = jnp.broadcast_to(width[None] / (2 * CELLS), (CELLS, *width.shape))
    centre = left[None] + half * jnp.arange(1, 2 * CELLS, 2, dtype=left.dtype)[:, None]
    return Front(
        centre=centre,
        half=half,
        lower_bound=jnp.full_like(centre, -jnp.inf),
        active=jnp.broadcast_to(active[None], centre.shape),
        low=infinite,
        high=infinite,
        at=jnp.zeros_like(infinite),
        overfull=jnp.zeros_like(active),
    )


def refine(build: Build, front: Front) -> Front:
    """One round: bound the minimum in every cell, and subdivide the cells where the function may be negative.

    A single undecided cell is divided into `CELLS` parts, two into half as many each, and up to four into halves.
    """
    enclosure = enclose_minimum(*interpolated(build(front.centre, front.half), semi_axes(front.half)))
    low, high = (jnp.where(front.active, x, jnp.inf) for x in (enclosure.low, enclosure.high))
    lowest = jnp.min(high, axis=0)
    first = jnp.min(jnp.where(high == lowest[None], front.centre + front.half * enclosure.at, 2.0), axis=0)
    better = lowest < front.high
    undecided = front.active & ~(low > 0)
    rank = jnp.cumsum(undecided, axis=0)
    count = rank[-1]
    parts = jnp.where(count == 1, CELLS, jnp.where(count == 2, CELLS // 2, CELLS // 4)).astype(rank.dtype)[None]
    cell = jnp.arange(CELLS, dtype=rank.dtype)[:, None]
    source = cell // parts
    from_source = undecided[None] & (rank[None] == source[:, None] + 1)
    overfull = count > CELLS // 2

    def of_source(x: Cells) -> Cells:
        return jnp.sum(jnp.where(from_source, x[None], 0.0), axis=1)

    half = of_source(front.half)
    offset = (2 * (cell - source * parts) + 1 - parts).astype(half.dtype)
    smaller = half / parts.astype(half.dtype)
    return Front(
        centre=of_source(front.centre) + smaller * offset,
        half=smaller,
        lower_bound=of_source(low),
        active=jnp.any(from_source, axis=1),
        low=jnp.minimum(front.low, jnp.min(jnp.where(undecided & ~overfull[None], jnp.inf, low), axis=0)),
        high=jnp.where(better, lowest, front.high),
        at=jnp.where(better, first, front.at),
        overfull=front.overfull | overfull,
    )


@jax.jit
def _evaluate(c: Float[Array, "k cells paths"], u: Cells) -> tuple[Cells, Cells, Cells]:
    """Value, slope and half the second derivative."""
    value, slope, half_curvature = taylor_terms(list(c), u, 2)
    return value, slope, half_curvature


def _newton_step(c: Float[Array, "k cells paths"], u: Cells) -> Cells:
    """Newton's step towards the minimum, clipped to [−1, 1]; no step where the polynomial is not convex."""
    _, slope, half_curvature = _evaluate(c, u)
    convex = half_curvature > 0
    return jnp.clip(u - jnp.where(convex, 0.5 * slope / jnp.where(convex, half_curvature, 1.0), 0.0), -1.0, 1.0)
