"""The motion of a vehicle on a retimed route, from which the frame `Driving` finds stops and headings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

PARTS = 4
"""Number of parts of a cell of the timing at whose ends the velocity is sampled."""


class RetimedMotion:
    """The same methods as those of `qtraj.path.stops.Segments`; the motion is smooth at the joints."""

    def __init__(self, path: Any):
        """Store the `RetimedPath`."""
        self._path = path

    @property
    def end(self) -> float:
        """The duration [s]."""
        return float(np.asarray(self._path.duration))

    def in_time(self) -> RetimedMotion:
        """Return the motion itself, which is a function of the time."""
        return self

    def rows(self, t: np.ndarray, order: int, side: str = "right") -> list[np.ndarray]:
        """Return position and derivatives up to `order`, each (m, 3), at times `t` (m,) [s]; `side` has no effect."""
        return [np.asarray(row) for row in self._path.sampled(t, order)]

    def sampled(self) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
        """Return sampled instants [s] and the velocities [m/s] at these instants."""
        knots = np.asarray(self._path.timing.times)
        parts = np.arange(PARTS) / PARTS
        t = np.append((knots[:-1, None] + np.diff(knots)[:, None] * parts).ravel(), knots[-1])
        return t, self.rows(t, 1)[1]

    def speed_sq_between(self, low: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the squared speed [m²/s²] at times (..., m)."""

        def speed_sq(t: np.ndarray) -> np.ndarray:
            v = self.rows(np.ravel(t), 1)[1].reshape(*np.shape(t), 3)
            return np.sum(v * v, axis=-1)

        return speed_sq
