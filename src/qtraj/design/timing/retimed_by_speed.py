"""Find where, in a cell of a timing, a quantity is nearest to a limit that depends on the speed, or violates it most.

Such a limit bends at some speeds. There, the quantity may touch or exceed it in a small part of a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import OfSpeed
from qtraj.design.proof.speed_claims import compared
from qtraj.design.timing.retimed_cells import Cells, motion_at
from qtraj.design.timing.timing import RetimedPath
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity

PLACES, BISECTIONS, ZOOMS = 257, 50, 4
"""Number of points in an interval, and number of steps to the places at which the limit bends, and to the maximum."""

Points = Float[np.ndarray, " m"]


class OnCell:
    """A quantity and its `limit` in one moving `cell` of a timing, at fractions of the cell."""

    def __init__(self, path: RetimedPath, cells: Cells, cell: int, name: str, limit: OfSpeed):
        self._at, self._limit, self._name = (path, cells, cell), limit, name
        edge = 1 / (PLACES - 1)  # next to a stop, rounding errors dominate the direction of motion
        first, last = (bool(np.asarray(stops)[cell]) for stops in cells.stops)
        self._ends = edge if first else 0.0, 1 - edge if last else 1.0

    def compared(self, place: Points) -> tuple[Points, Points]:
        """Return the values of the quantity and of the limit."""
        value, limit = compared(Invariants([None, *self._motion(place)]), self._name, self._limit)
        return np.asarray(value), np.broadcast_to(limit, place.shape)

    def worst(self) -> float:
        """Return the place at which the quantity exceeds its limit most."""
        low, high = self._ends
        best, around = low, np.linspace(low, high, PLACES)
        for zoom in range(ZOOMS):
            places = np.concatenate([around, self._bends(around)]) if zoom == 0 else around
            value, limit = self.compared(places)
            excess = quantity(self._name).side * (value - limit)
            best = float(places[np.argmax(np.where(np.isnan(excess), -np.inf, excess))])
            width = (high - low) * (2 / (PLACES - 1)) ** (zoom + 1)
            around = np.clip(best + 0.5 * width * np.linspace(-1, 1, PLACES), low, high)
        return best

    def _bends(self, places: Points) -> Points:
        """Return the places between neighbouring ones at which the speed is one at which the limit bends."""
        curves = [x for x in jax.tree.leaves(self._limit, is_leaf=_is_curve) if _is_curve(x)]
        speeds = np.unique(np.concatenate([np.asarray(x.speeds, float) for x in curves]))
        above = self._speed(places)[:, None] > speeds
        k, bend = np.nonzero(above[1:] != above[:-1])
        return _crossings(self._speed, places[k], places[k + 1], speeds[bend], above[k, bend])

    def _speed(self, place: Points) -> Points:
        velocity = self._motion(place)[0]
        return np.sqrt(sum(x * x for x in velocity))

    def _motion(self, place: Points) -> list[Any]:
        """Return the velocity and the acceleration."""
        path, cells, cell = self._at
        r, v = (np.asarray(x) for x in motion_at(path, cells, np.full(place.shape, cell), place))
        a, slope = v[0], v[1]
        return [
            tuple(np.sqrt(np.maximum(a, 0.0)) * x for x in r[0]),
            tuple(a * y + 0.5 * slope * x for x, y in zip(*r[:2], strict=True)),
        ]


def _is_curve(x: Any) -> bool:
    return isinstance(x, BySpeed)


def _crossings(
    function: Callable[[Points], Points], low: Points, high: Points, goal: Points, falls: np.ndarray
) -> Points:
    """Return where the function is `goal`, between places of which it is above it only at `low` if it `falls`."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        left = (function(middle) > goal) == falls
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    return 0.5 * (low + high)
