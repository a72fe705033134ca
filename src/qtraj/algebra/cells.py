"""Branch and bound on [−1, 1]: bound the minimum of a function in cells, and subdivide the undecided cells.

In a cell (a subinterval), the function is a polynomial plus a bounded error. The smallest Bernstein coefficient is a
lower bound on the polynomial. If the polynomial is convex, its tangent at any point is a second lower bound. A tangent
near the minimum yields a much tighter bound, so the cells need not become very small. Each round performs a fixed
number of operations for many paths at once. The bounds include all rounding errors.
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
"""Number of cells in a round; a power of two, so that the ends of the cells are exact floating-point numbers."""

MIN_HALF_WIDTH = 2.0**-26
"""The search ends for a path if the half widths of all its undecided cells are at most this number."""

NEWTON_STEPS = 3

Cells = Float[Array, "cells paths"]
PerPath = Float[Array, " paths"]

Build = Callable[[Cells, Cells], ChebyshevModel]
"""A function that maps the centres and half widths of cells to the model of the functions in these cells.

Each cell is scaled to [−1, 1].
"""


class Enclosure(eqx.Module):
    """Bounds on the minimum of a function in each cell.

    The minimum lies in [`low`, `high`]. `at` is a point in the cell, scaled to [−1, 1], at which the value is at most
    `high`.
    """

    low: Cells
    high: Cells
    at: Cells


def semi_axes(half: Cells) -> Float[Array, "ellipses cells paths"]:
    """Return the semi-major axes of the ellipses on which functions are bounded, divided by the half width of the cell.

    In small cells the largest ellipse yields the best bound. If a function varies rapidly, a small ellipse is better.
    """
    fixed = [jnp.full_like(half, x) for x in SEMI_AXES]
    return jnp.stack([*fixed, jnp.maximum(MIN_LAST_SEMI_AXIS, 0.25 / half)])


@jax.jit
def enclose_minimum(c: Float[Array, "k cells paths"], error: Cells) -> Enclosure:
    """Bound, in each cell, the minimum of a function that differs by at most `error` from Σ c_k s^k, s ∈ [−1, 1].

    `c[k]` contains the coefficient c_k in each cell.
    """
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
    # An overflow yields NaN, which is replaced by infinite bounds.
    return Enclosure(jnp.where(jnp.isnan(low), -jnp.inf, low), jnp.where(jnp.isnan(high), jnp.inf, high), at)


def _to_bernstein(count: int) -> np.ndarray:
    """Return the matrix, with entries in [−1, 1], that converts power to Bernstein coefficients on [−1, 1].

    The rows are the Bernstein coefficients, and the columns are the powers.
    """
    n = count - 1

    def entry(j: int, k: int) -> float:
        numerator = sum((-1) ** (k - i) * math.comb(j, i) * math.comb(n - j, k - i) for i in range(k + 1))
        return numerator / math.comb(n, k)

    return np.array([[entry(j, k) for k in range(count)] for j in range(count)])


def _quadratic_minimum(c: Float[Array, "k cells paths"]) -> Cells:
    """Return the point s of [−1, 1] at which c_0 + c_1 s + c_2 s² is smallest, c_k = `c[k]`; 0 if c_1 is zero."""
    convex, slope = c[2] > 0, jnp.abs(c[1])
    return -jnp.sign(c[1]) * jnp.where(convex, jnp.minimum(slope / jnp.where(convex, 2 * c[2], 1.0), 1.0), 1.0)


class Front(eqx.Module):
    """State of the search: the undecided cells, and bounds from the decided cells.

    The undecided cells are `centre` ± `half` where `active` is true. In each of them, `lower_bound` is a lower bound on
    the function; in all decided cells, `low` is a lower bound. `at` is the point with the smallest value found so far;
    this value is at most `high`. `overfull` is true if a round had more undecided cells than it could subdivide.
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
        """For each path, whether an undecided cell can still be subdivided."""
        return jnp.any(self.active & (self.half > MIN_HALF_WIDTH), axis=0) & ~self.overfull


def initial_front(left: PerPath, width: PerPath, active: Bool[Array, " paths"]) -> Front:
    """Divide the subintervals [left, left + width] of [−1, 1] into cells, which are active for the `active` paths."""
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
    """Perform one round: bound the minimum in every cell, and subdivide the cells without a proof of positivity.

    One undecided cell is divided into `CELLS` cells, two cells into `CELLS`/2 cells each, and three or four cells into
    `CELLS`/4 cells each. More than four undecided cells are too many; `overfull` is then true.
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
    """Return the value, the slope and half the second derivative of Σ c_k s^k at s = `u`, with c_k = `c[k]`."""
    value, slope, half_curvature = taylor_terms(list(c), u, 2)
    return value, slope, half_curvature


def _newton_step(c: Float[Array, "k cells paths"], u: Cells) -> Cells:
    """Return `u` after a Newton step to the minimum of Σ c_k s^k, c_k = `c[k]`, clipped to [−1, 1].

    Where the polynomial is not convex at `u`, `u` is only clipped.
    """
    _, slope, half_curvature = _evaluate(c, u)
    convex = half_curvature > 0
    return jnp.clip(u - jnp.where(convex, 0.5 * slope / jnp.where(convex, half_curvature, 1.0), 0.0), -1.0, 1.0)
