"""The distances travelled along the paths of a batch of searches, and the times at which they are reached."""

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.searches import Curves

NODES, WEIGHTS = ((x + 1) / 2 if k == 0 else x / 2 for k, x in enumerate(np.polynomial.legendre.leggauss(8)))
PANELS, STEPS = 16, 16
"""Number of panels of the quadrature of the distance, and of steps of Newton's method for the time at a distance."""


class Travelled:
    """The distances travelled along the paths of a batch, by quadrature on panels of the time."""

    def __init__(self, curves: Curves, count: int):
        self.curves, self.count = curves, count
        u = (np.arange(PANELS)[:, None] + NODES).ravel() / PANELS
        speeds = self._speeds(u[:, None]).reshape(PANELS, NODES.size, count)
        steps = np.einsum("pkb,k->pb", speeds, WEIGHTS / PANELS)
        self.at_ends = np.concatenate([np.zeros((1, count)), np.cumsum(steps, axis=0)])

    @property
    def length(self) -> Float[np.ndarray, " batch"]:
        """The lengths of the paths [m]."""
        return self.at_ends[-1]

    def at(self, u: Float[np.ndarray, "k batch"]) -> Float[np.ndarray, "k batch"]:
        """Return the distances [m] at times in units of the duration."""
        panel = np.clip((u * PANELS).astype(int), 0, PANELS - 1)
        return np.take_along_axis(self.at_ends, panel, axis=0) + self._between(panel / PANELS, u)

    def times(self, distance: Float[np.ndarray, " batch"]) -> Float[np.ndarray, " batch"]:
        """Return the times at distances [m], in units of the duration, between 0 and 1."""
        panel = np.clip((self.at_ends < distance).sum(axis=0) - 1, 0, PANELS - 1)
        before, after = (np.take_along_axis(self.at_ends, (panel + k)[None], axis=0)[0] for k in (0, 1))
        start, rest = panel / PANELS, np.clip(distance, 0.0, self.length) - before
        low, high = start, start + 1 / PANELS
        u = start + np.clip(rest / (after - before), 0.0, 1.0) / PANELS
        for _ in range(STEPS):
            error = self._between(start[None], u[None])[0] - rest
            low, high = np.where(error <= 0, u, low), np.where(error >= 0, u, high)
            new = u - error / self._speeds(u[None])[0]
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            if (np.abs(new - u) <= 1e-16).all():
                break
            u = new
        return np.where(distance <= 0, 0.0, np.where(distance >= self.length, 1.0, u))

    def _between(self, a: Float[np.ndarray, "k batch"], b: Float[np.ndarray, "k batch"]) -> np.ndarray:
        u = a + (b - a) * NODES[:, None, None]
        return (b - a) * np.einsum("nkb,n->kb", self._speeds(u.reshape(-1, self.count)).reshape(u.shape), WEIGHTS)

    def _speeds(self, u: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.curves.speeds(u), (len(u), self.count))
