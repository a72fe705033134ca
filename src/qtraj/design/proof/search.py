"""Find the maximum of a function on [−1, 1] for a batch of paths, from function values only.

The interval [−1, 1] is divided into windows of eleven instants each. The candidate of a window is the instant with the
largest value, or the vertex of the parabola through this instant and its neighbours. Narrower windows about the three
best candidates refine the maximum. For any number of windows, the search is one loop whose body evaluates the function
once.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.cells import PerPath

WINDOWS = 3
"""Number of windows that are evaluated together, and number of candidates that are refined."""

OFFSETS = np.linspace(-1.0, 1.0, 11)
"""The instants of a window, in units of its half-width."""

NARROWING = 8.0
"""Each refinement narrows the windows by this factor."""

REFINEMENTS = 4
"""Number of refinements."""

TIE = 4.0
"""The value at the centre of a window is preferred to the largest value unless they differ by more than this.

The unit is the machine epsilon times the value. The centre is the vertex of the parabola of the previous round, and its
time is more accurate.
"""

Windows = Float[Array, "windows paths"]
Function = Callable[[Float[Array, "instants paths"]], Float[Array, "instants paths"]]


class MaximumState(NamedTuple):
    """The largest value found so far, its rank (infinite for NaN), its instant, and the candidates.

    `heights` and `places` are the values and the instants of the candidates.
    """

    rank: PerPath
    value: PerPath
    at: PerPath
    heights: Windows
    places: Windows


def find_maximum(function: Function, hints: Windows, chunks: Int[Array, ""]) -> tuple[PerPath, PerPath]:
    """Return the maximum and its instant; the maximum is NaN if any value is NaN.

    The search evaluates 30·`chunks` intervals and windows about the instants `hints`. With zero chunks the function is
    not evaluated, and the first hint is returned with the value −inf.
    """
    nothing = jnp.full_like(hints[0], -jnp.inf)
    start = MaximumState(nothing, nothing, hints[0], jnp.full_like(hints, -jnp.inf), hints)
    spacing = 2 / (WINDOWS * (OFFSETS.size - 1) * jnp.maximum(chunks, 1).astype(hints.dtype))
    rounds = jnp.where(chunks > 0, chunks + 1 + REFINEMENTS, 0)

    def step(k: Array, state: MaximumState) -> MaximumState:
        first, refining = k <= chunks, k > chunks
        order = (WINDOWS * k + jnp.arange(WINDOWS)).astype(hints.dtype)[:, None]
        tiled = (order * 2 + 1) * (0.5 * (OFFSETS.size - 1)) * spacing - 1
        centres = jnp.where(refining, state.places, jnp.where(k == chunks, hints, tiled))
        narrow = spacing * NARROWING ** (chunks + 1 - k).astype(hints.dtype)
        half = jnp.where(refining, narrow, jnp.where(k == chunks, spacing, 0.5 * (OFFSETS.size - 1) * spacing))
        return _step(function, state, centres, half, first)

    state = jax.lax.fori_loop(0, rounds, step, start)
    return state.value, state.at


def _step(function: Function, state: MaximumState, centres: Windows, half: Array, first: Array) -> MaximumState:
    """Evaluate windows, and select the best candidates; if `first` is false, the previous candidates are dropped."""
    s = jnp.clip(centres[:, None] + half * jnp.asarray(OFFSETS, centres.dtype)[None, :, None], -1.0, 1.0)
    raw = function(s.reshape(-1, s.shape[-1])).reshape(s.shape)
    values = jnp.where(jnp.isnan(raw), jnp.inf, raw)
    # A centre is the vertex of the previous round. Among equal values, prefer the centre: it is the best estimate of
    # the instant of the maximum.
    centre = jnp.asarray(OFFSETS == 0)[None, :, None] & ~first
    rank = values + jnp.where(centre, TIE * float(jnp.finfo(values.dtype).eps) * jnp.abs(values), 0.0)
    end = jnp.full_like(values[:, :1], jnp.inf)
    left, right = jnp.concatenate([end, values[:, :-1]], axis=1), jnp.concatenate([values[:, 1:], end], axis=1)
    rank, raw, s, left, right = _maximum((rank, raw, s, left, right), 1)
    heights, places = _vertex(rank, raw, s, left, right, half * (OFFSETS[1] - OFFSETS[0]))
    previous = jnp.where(first, state.heights, -jnp.inf)
    heights, places = _top_candidates(jnp.concatenate([heights, previous]), jnp.concatenate([places, state.places]))
    best = _maximum((rank, raw, s), 0)
    better = best[0] > state.rank
    rank, value, at = (jnp.where(better, new, old) for new, old in zip(best, state[:3], strict=True))
    return MaximumState(rank, value, at, heights, places)


def _vertex(
    rank: Windows, middle: Windows, s: Windows, left: Windows, right: Windows, step: Array
) -> tuple[Windows, Windows]:
    """Return the value and the instant of the vertex of the parabola through three values.

    Where the parabola has no maximum between the outer instants, return the rank and the instant of the middle value.
    """
    curvature = 2 * middle - left - right
    peak = (middle >= left) & (middle >= right) & (curvature > 0) & (curvature < jnp.inf)
    move = jnp.where(peak, (right - left) / jnp.where(peak, 2 * curvature, 1.0), 0.0)
    height = jnp.where(peak, middle + 0.25 * move * (right - left), rank)
    return height, jnp.clip(s + step * move, -1.0, 1.0)


def _maximum(operands: tuple[Array, ...], axis: int) -> tuple[Array, ...]:
    """Return the maximum of the first operand, and the other operands at its index; ties are resolved arbitrarily."""

    def larger(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
        return tuple(jnp.where(b[0] > a[0], y, x) for x, y in zip(a, b, strict=True))

    nothing = jnp.asarray(-jnp.inf, operands[0].dtype)
    return jax.lax.reduce(operands, (nothing,) * len(operands), larger, (axis,))


def _top_candidates(heights: Float[Array, "n paths"], places: Float[Array, "n paths"]) -> tuple[Windows, Windows]:
    """Return the `WINDOWS` highest candidates, in decreasing order."""
    n = heights.shape[0]
    own, other = heights[:, None], heights[None]
    earlier = jnp.asarray(np.tri(n, k=-1, dtype=bool))[:, :, None]
    rank = jnp.sum((other > own) | ((other == own) & earlier), axis=1)
    chosen = rank[None] == jnp.arange(WINDOWS, dtype=rank.dtype)[:, None, None]
    pick = lambda x: jnp.sum(jnp.where(chosen, x[None], 0.0), axis=1)  # noqa: E731
    return pick(heights), pick(places)
