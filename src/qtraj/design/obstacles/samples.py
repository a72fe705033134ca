"""Clearances of the pieces of a path in floats: samples, and their refined minima."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from qtraj.design.obstacles.body import Body
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.obstacles.piece import Piece, floats
from qtraj.design.proof.maxima import PEAKS, find_maxima

GRID = np.linspace(0.0, 1.0, 33)
"""The fractions of each piece that are sampled."""

WINDOW, WINDOWS = np.linspace(-1.0, 1.0, 9), 15
"""The instants of a window in units of its half-width, which becomes a quarter each time, and the number of windows."""


class Samples:
    """The pieces in floats, for concrete obstacles and a concrete `body`."""

    def __init__(self, pieces: Sequence[Piece], body: Body):
        self._body, self._count = body, len(pieces)
        self._position = floats([x.position for x in pieces])
        offsets = np.asarray(body.offsets, float).tolist()
        zero = [pieces[0].position[0] * 0] * 3
        self._direction = floats([zero if x.direction is None else x.direction for x in pieces])
        self._unknown = np.array([[not x.knows(offset) for x in pieces] for offset in offsets])
        self._sign = np.array([x.sign or 1 for x in pieces], float)
        self._time = floats([[x.time] * 3 for x in pieces])[..., 0]
        self._offset = np.linalg.norm(np.asarray(body.offsets, float), axis=1)

    def centres(self, u: np.ndarray, chosen: Any = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Return the centres (m, k, n, 3) and the times (k, n) at fractions `u` (k, n) of the `chosen` pieces."""
        position = _horner(self._position[:, chosen], u[..., None])
        direction = _horner(self._direction[:, chosen], u[..., None])
        with np.errstate(invalid="ignore"):
            centres = np.asarray(self._body.centres(position, direction, self._sign[chosen]))
        return np.where(np.isnan(centres), position, centres), _horner(self._time[:, chosen], u)

    def clearances(self, obstacle: AbstractObstacle, u: np.ndarray, chosen: Any = slice(None)) -> np.ndarray:
        """Return the clearances (k, n) [m] of the body at fractions `u` (k, n)."""
        centres, times = self.centres(u, chosen)
        radii = np.asarray(self._body.radii, float)[:, None, None]
        reach = radii + np.where(self._unknown[:, None, chosen], self._offset[:, None, None], 0.0)
        return np.min(
            np.asarray(obstacle.distance(centres, np.broadcast_to(times, centres.shape[:-1]))) - reach, axis=0
        )

    def smallest(self, obstacle: AbstractObstacle) -> tuple[np.ndarray, np.ndarray]:
        """Return the fraction and the value of the smallest clearance of each piece; refined only where it is small."""
        grid = np.repeat(GRID[:, None], self._count, axis=1)
        samples = self.clearances(obstacle, grid)
        k = np.argmin(samples, axis=0)
        at, values = GRID[k], samples[k, np.arange(self._count)]
        centres = self.centres(grid)[0]
        step = np.linalg.norm(np.diff(centres, axis=1), axis=-1).max(axis=(0, 1))
        near = np.flatnonzero(values <= max(values.min(), 0.0) + 2 * step + step.max())
        function = lambda u: -self.clearances(obstacle, u, near)  # noqa: E731
        own_at, own = find_maxima(function, GRID, -samples[:, near])
        own_at = np.clip(own_at, 0.0, 1.0)
        own = np.minimum(-own, self.clearances(obstacle, own_at[None], near)[0])
        inside = np.flatnonzero(own < 0)  # inside a polygon the clearance has kinks, where parabolas are inaccurate
        if inside.size:
            function = lambda u: self.clearances(obstacle, u, near[inside])  # noqa: E731
            found_at, found = _narrowed(function, samples[:, near[inside]])
            lower = found < own[inside]
            own_at[inside[lower]], own[inside[lower]] = found_at[lower], found[lower]
        better = own <= values[near]
        at[near[better]], values[near[better]] = own_at[better], own[better]
        return at, values


def _narrowed(function: Any, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the fractions and values of minima, from values in narrower and narrower windows about local minima."""
    end = np.full_like(samples[:1], np.inf)
    low = (samples <= np.concatenate([end, samples[:-1]])) & (samples <= np.concatenate([samples[1:], end]))
    first = np.argsort(np.where(low, samples, np.inf), axis=0)[:PEAKS]
    at, values, width = GRID[first], np.take_along_axis(samples, first, axis=0), GRID[1]
    for _ in range(WINDOWS):
        u = np.clip(at[:, None] + width * WINDOW[:, None], 0.0, 1.0)
        found = function(u.reshape(-1, u.shape[2])).reshape(u.shape)
        k = np.argmin(found, axis=1)[:, None]
        at, values = (np.take_along_axis(x, k, axis=1)[:, 0] for x in (u, found))
        width *= WINDOW[-1] - WINDOW[-2]
    best = np.argmin(values, axis=0)[None]
    return np.take_along_axis(at, best, axis=0)[0], np.take_along_axis(values, best, axis=0)[0]


def _horner(c: np.ndarray, u: np.ndarray) -> np.ndarray:
    found = c[-1] + 0.0 * u
    for k in range(len(c) - 2, -1, -1):
        found = c[k] + u * found
    return found
