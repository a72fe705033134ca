"""Find the maxima of functions on [0, 1] for a batch of paths, from function values only, in NumPy or JAX.

The functions are sampled on a grid. The highest local maxima are refined by parabolas on narrower and narrower windows.
A narrow peak that is well below the largest sample can be missed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from qtraj.foundation.namespace import xp

PEAKS = 4
"""Number of local maxima of the samples that are refined."""

OFFSETS = np.linspace(-1.0, 1.0, 7)
"""The instants of a window, in units of its half-width."""

WIDE, NARROW = (1.0, 1 / 2), (1 / 4, 1 / 8, 1 / 16, 1 / 64, 1 / 512, 1 / 4096)
"""Half-widths of the windows about all local maxima, and then about the highest one, in units of the samples' spacing.

A window contains the instants next to the largest value in the previous window.
"""

SHARP = 1e-3
"""If a squared divisor is somewhere below this fraction of its largest value, narrow peaks are sought at its minima."""

Function = Callable[[Float[np.ndarray, "k n"]], Float[np.ndarray, "k n"]]


def find_maxima(
    function: Function,
    grid: Float[np.ndarray, " k"],
    samples: Float[np.ndarray, "k n"],
    hints: Float[np.ndarray, "hints n"] | None = None,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the instants and the values of the maxima of n functions, whose `samples` on the `grid` are given.

    `hints` are additional instants from which the maximum is refined. NaN counts as infinite.
    """
    count, spacing = samples.shape[1], 1 / (len(grid) - 1)
    samples = xp.where(xp.isnan(samples), np.inf, samples)
    with np.errstate(invalid="ignore", over="ignore"):
        best_at, best = _highest(np.broadcast_to(grid[:, None], samples.shape), samples)
        centres = _peaks(samples, grid)
        if hints is not None:
            centres = xp.concatenate([centres, hints])
        for width in (*WIDE, *NARROW):
            u, values = _windows(function, centres, spacing * width)
            at, highest = _highest(u.reshape(-1, count), values.reshape(-1, count))
            best_at, best = xp.where(highest > best, at, best_at), xp.maximum(highest, best)
            centres = _vertices(u, values)
            if width == WIDE[-1]:
                place = xp.argmax(xp.max(values, axis=1), axis=0)[None]
                centres = xp.take_along_axis(centres, place, axis=0)
        at, highest = centres[0], function(centres)[0]
        # Among equal values, prefer the vertex of a parabola: it is the best estimate of the instant of the maximum.
        chosen = highest >= best - 4 * np.finfo(float).eps * abs(best)
    return xp.where(chosen, at, best_at), xp.where(chosen, xp.fmax(highest, best), best)


def local_maxima(
    function: Function, grid: Float[np.ndarray, " k"], samples: Float[np.ndarray, "k n"]
) -> Float[np.ndarray, "peaks n"]:
    """Return the instants of the highest local maxima of n functions; unused rows contain other instants."""
    centres = _peaks(samples, grid)
    for width in (*WIDE, *NARROW):
        centres = _vertices(*_windows(function, centres, width / (len(grid) - 1)))
    return centres


def sharp_minima(squares: Function, grid: Float[np.ndarray, " k"]) -> Float[np.ndarray, "peaks n"] | None:
    """Return the instants of the smallest squared divisors, near which a quantity may have narrow peaks, if any."""
    samples = squares(grid)
    sharp = np.min(samples, axis=0) < SHARP * np.max(samples, axis=0)
    return local_maxima(lambda u: -squares(u), grid, -samples) if np.any(sharp) else None


def _windows(
    function: Function, centres: Float[np.ndarray, "p n"], half_width: float
) -> tuple[Float[np.ndarray, "p 7 n"], Float[np.ndarray, "p 7 n"]]:
    """Return the instants and the values of windows about the given instants; NaN counts as infinite."""
    u = xp.clip(centres[:, None] + half_width * OFFSETS[None, :, None], 0.0, 1.0)
    values = function(u.reshape(-1, u.shape[2])).reshape(u.shape)
    return u, xp.where(xp.isnan(values), np.inf, values)


def _highest(u: Float[np.ndarray, "k n"], values: Float[np.ndarray, "k n"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the instants and values of the largest value in each column."""
    place = xp.argmax(values, axis=0)[None]
    return xp.take_along_axis(u, place, axis=0)[0], xp.take_along_axis(values, place, axis=0)[0]


def _peaks(samples: Float[np.ndarray, "k n"], grid: Float[np.ndarray, " k"]) -> Float[np.ndarray, "peaks n"]:
    """Return the instants of the highest local maxima of the samples, refined by one parabola."""
    end = xp.full_like(samples[:1], -np.inf)
    left, right = xp.concatenate([end, samples[:-1]]), xp.concatenate([samples[1:], end])
    heights = xp.where((samples >= left) & (samples >= right), samples, -np.inf)
    order = xp.argpartition(-heights, PEAKS, axis=0)[:PEAKS]
    inner = xp.clip(order, 1, len(grid) - 2)
    take = lambda k: xp.take_along_axis(samples, k, axis=0)  # noqa: E731
    values = xp.stack([take(inner - 1), take(inner), take(inner + 1)], axis=1)
    nodes = xp.take_along_axis(np.broadcast_to(grid[:, None], samples.shape), order, axis=0)
    return xp.where(order == inner, nodes + (grid[1] - grid[0]) * _shift(values), nodes)


def _vertices(u: Float[np.ndarray, "p 7 n"], values: Float[np.ndarray, "p 7 n"]) -> Float[np.ndarray, "p n"]:
    """Return the vertex of the parabola through the highest value in each window and its neighbours."""
    inner = xp.clip(xp.argmax(values, axis=1), 1, len(OFFSETS) - 2)[:, None]
    take = lambda a, k: xp.take_along_axis(a, k, axis=1)[:, 0]  # noqa: E731
    near = xp.stack([take(values, inner - 1), take(values, inner), take(values, inner + 1)], axis=1)
    spacing = take(u, inner + 1) - take(u, inner)
    return xp.clip(take(u, inner) + spacing * _shift(near), 0.0, 1.0)


def _shift(values: Float[np.ndarray, "p 3 n"]) -> Float[np.ndarray, "p n"]:
    """Return the place of the vertex of the parabola through three values, in [−1, 1] units of their spacing."""
    left, middle, right = values[:, 0], values[:, 1], values[:, 2]
    curvature = 2 * middle - left - right
    fine = (curvature > 0) & (curvature < np.inf)
    shift = xp.where(fine, 0.5 * (right - left) / xp.where(fine, curvature, 1.0), xp.sign(right - left))
    return xp.where(xp.isfinite(shift), xp.clip(shift, -1.0, 1.0), 0.0)
