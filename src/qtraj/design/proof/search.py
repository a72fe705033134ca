"""Where a function of time is largest on [−1, 1], for many paths at once, from its values alone.

[−1, 1] is divided into windows, each with eleven instants. Of a window the highest instant counts, or the vertex of the
parabola through it and its neighbours; about the three highest of all windows ever narrower ones are laid. All of it is
one loop over one evaluation of the function, however many windows there are.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.cells import PerPath

WINDOWS = 3
"""Evaluated at once, and kept as candidates."""

OFFSETS = np.linspace(-1.0, 1.0, 11)
"""The instants of a window, in its half widths."""

NARROWER = 8.0
"""By this factor a window is narrower than the one before, where it is laid about a candidate."""

POLISHED = 4
"""How often narrower windows are laid."""

TIE = 4.0
"""Units of round-off below the highest value: a vertex with such a value is as good, and its time is better known."""

Windows = Float[Array, "windows paths"]
Function = Callable[[Float[Array, "instants paths"]], Float[Array, "instants paths"]]


class Highest(NamedTuple):
    """The highest value seen, its rank (infinite where it is not a number), where it is, and the candidates."""

    rank: PerPath
    value: PerPath
    at: PerPath
    heights: Windows
    places: Windows


def highest(function: Function, hints: Windows, chunks: Int[Array, ""]) -> tuple[PerPath, PerPath]:
    """The largest value and where it is, from 30·`chunks` intervals and about `hints`; NaN where a value is NaN.

    With no chunks nothing is evaluated, and the first of the hints is returned.
    """
    none = jnp.full_like(hints[0], -jnp.inf)
    start = Highest(none, none, hints[0], jnp.full_like(hints, -jnp.inf), hints)
    spacing = 2 / (WINDOWS * (OFFSETS.size - 1) * jnp.maximum(chunks, 1).astype(hints.dtype))
    rounds = jnp.where(chunks > 0, chunks + 1 + POLISHED, 0)

    def step(k: Array, found: Highest) -> Highest:
        first, polished = k <= chunks, k > chunks
        order = (WINDOWS * k + jnp.arange(WINDOWS)).astype(hints.dtype)[:, None]
        tiled = (order * 2 + 1) * (0.5 * (OFFSETS.size - 1)) * spacing - 1
        centres = jnp.where(polished, found.places, jnp.where(k == chunks, hints, tiled))
        narrow = spacing * NARROWER ** (chunks + 1 - k).astype(hints.dtype)
        half = jnp.where(polished, narrow, jnp.where(k == chunks, spacing, 0.5 * (OFFSETS.size - 1) * spacing))
        return _step(function, found, centres, half, first)

    found = jax.lax.fori_loop(0, rounds, step, start)
    return found.value, found.at


def _step(function: Function, found: Highest, centres: Windows, half: Array, first: Array) -> Highest:
    """Evaluate windows; they are merged with the candidates, or take their places where these are polished."""
    s = jnp.clip(centres[:, None] + half * jnp.asarray(OFFSETS, centres.dtype)[None, :, None], -1.0, 1.0)
    raw = function(s.reshape(-1, s.shape[-1])).reshape(s.shape)
    values = jnp.where(jnp.isnan(raw), jnp.inf, raw)
    # A centre is the vertex of the round before: among equals it is where the maximum is.
    centre = jnp.asarray(OFFSETS == 0)[None, :, None] & ~first
    rank = values + jnp.where(centre, TIE * float(jnp.finfo(values.dtype).eps) * jnp.abs(values), 0.0)
    end = jnp.full_like(values[:, :1], jnp.inf)
    left, right = jnp.concatenate([end, values[:, :-1]], axis=1), jnp.concatenate([values[:, 1:], end], axis=1)
    rank, raw, s, left, right = _largest((rank, raw, s, left, right), 1)
    heights, places = _vertex(rank, raw, s, left, right, half * (OFFSETS[1] - OFFSETS[0]))
    kept = jnp.where(first, found.heights, -jnp.inf)
    heights, places = _top(jnp.concatenate([heights, kept]), jnp.concatenate([places, found.places]))
    best = _largest((rank, raw, s), 0)
    better = best[0] > found.rank
    rank, value, at = (jnp.where(better, new, old) for new, old in zip(best, found[:3], strict=True))
    return Highest(rank, value, at, heights, places)


def _vertex(
    rank: Windows, middle: Windows, s: Windows, left: Windows, right: Windows, step: Array
) -> tuple[Windows, Windows]:
    """Height and place of the vertex of the parabola through three values; of the middle where there is none."""
    bend = 2 * middle - left - right
    peak = (middle >= left) & (middle >= right) & (bend > 0) & (bend < jnp.inf)
    move = jnp.where(peak, (right - left) / jnp.where(peak, 2 * bend, 1.0), 0.0)
    height = jnp.where(peak, middle + 0.25 * move * (right - left), rank)
    return height, jnp.clip(s + step * move, -1.0, 1.0)


def _largest(operands: tuple[Array, ...], axis: int) -> tuple[Array, ...]:
    """The largest of the first operand, and what stands in its place in the others; one of equals."""

    def larger(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
        return tuple(jnp.where(b[0] > a[0], y, x) for x, y in zip(a, b, strict=True))

    none = jnp.asarray(-jnp.inf, operands[0].dtype)
    return jax.lax.reduce(operands, (none,) * len(operands), larger, (axis,))


def _top(heights: Float[Array, "n paths"], places: Float[Array, "n paths"]) -> tuple[Windows, Windows]:
    """The highest `WINDOWS`, in order."""
    n = heights.shape[0]
    mine, other = heights[:, None], heights[None]
    earlier = jnp.asarray(np.tri(n, k=-1, dtype=bool))[:, :, None]
    rank = jnp.sum((other > mine) | ((other == mine) & earlier), axis=1)
    chosen = rank[None] == jnp.arange(WINDOWS, dtype=rank.dtype)[:, None, None]
    pick = lambda x: jnp.sum(jnp.where(chosen, x[None], 0.0), axis=1)  # noqa: E731
    return pick(heights), pick(places)
