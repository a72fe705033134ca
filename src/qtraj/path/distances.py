"""Relate the parameter of a path to the distance travelled, by quadrature on panels."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_array
from qtraj.foundation.namespace import in_numpy
from qtraj.path.hodograph import AbstractHodograph

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)

PANELS, DOUBLINGS = 32, 10
"""Number of panels of a path that is smooth everywhere, and the largest number of times that panels are halved."""

CONVERGED, UNCERTAINTY = 1e-11, 1e-9
"""Change of the length below which the panels are small enough, and the bound on the error of a distance; both relative
to the length of the path."""

STEPS, ROUNDINGS = 100, 4 * np.finfo(float).eps
"""Largest number of steps of the search for a distance, which mostly takes five, and the accuracy of its result,
relative to the end of a panel."""


class Distances(NamedTuple):
    """The distances `at_ends` (n + 1,) [m] of the `ends` of n panels of the parameter of a path."""

    path: AbstractHodograph
    ends: Float[np.ndarray, " n+1"]
    at_ends: Float[np.ndarray, " n+1"]

    @property
    def length(self) -> float:
        """The length of the path [m]."""
        return float(self.at_ends[-1])

    @property
    def uncertainty(self) -> float:
        """A bound on the error of a distance [m]."""
        return UNCERTAINTY * self.length

    def at(self, u: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the distances [m] at the parameters `u`."""
        k = np.clip(np.searchsorted(self.ends, u, side="right") - 1, 0, self.ends.size - 2)
        return self.at_ends[k] + _lengths(self.path, self.ends[k], u)

    def parameters(self, s: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the smallest parameters at which the distance is `s` [m]; the ends of the path for others."""
        k = np.clip(np.searchsorted(self.at_ends, s) - 1, 0, self.ends.size - 2)
        found = np.where(s >= self.at_ends[k + 1], self.ends[k + 1], self.ends[k])
        inside = np.flatnonzero((s > self.at_ends[k]) & (s < self.at_ends[k + 1]))
        found[inside] = self._inside(k[inside], (s - self.at_ends[k])[inside])
        return found

    def _inside(self, k: Int[np.ndarray, " m"], rest: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the parameters in the panels `k` at the distances `rest` from their starts.

        A step of Newton's method is replaced by a bisection if it leaves the bounds, or halves too little.
        """
        start, low, high = self.ends[k], self.ends[k], self.ends[k + 1]
        u = low + (high - low) * rest / (self.at_ends[k + 1] - self.at_ends[k])
        last, open_ = high - low, np.full(k.size, True)
        for _ in range(STEPS):
            if not open_.any():
                break
            excess, pace = _lengths(self.path, start, u) - rest, paces(self.path, u)
            low, high = np.where(excess < 0, u, low), np.where(excess < 0, high, u)
            step = -excess / np.where(pace > 0, pace, np.nan)
            newton = (low <= u + step) & (u + step <= high) & (2 * abs(step) <= last)
            step = np.where(newton, step, 0.5 * (low + high) - u)
            last, u = np.where(open_, abs(step), last), np.where(open_, u + step, u)
            open_ &= last > ROUNDINGS * self.ends[k + 1]
        return u


def distances(path: AbstractHodograph) -> Distances:
    """Return the distances along one path with concrete values; its panels are halved until the length converges."""
    nodes, duration = path.nodes(), float(path.duration)
    given = np.linspace(0.0, duration, PANELS + 1) if nodes is None else np.asarray(nodes, float)
    ends = np.unique(np.append(given, [0.0, duration]))  # the last of the nodes may be before the duration
    before, steps = np.inf, _lengths(path, ends[:-1], ends[1:])
    for _ in range(DOUBLINGS):
        if not abs(steps.sum() - before) > CONVERGED * steps.sum():
            break
        before = steps.sum()
        ends = np.append(np.stack([ends[:-1], 0.5 * (ends[:-1] + ends[1:])], axis=1).ravel(), ends[-1])
        steps = _lengths(path, ends[:-1], ends[1:])
    return Distances(path, ends, np.append(0.0, np.cumsum(steps)))


def distances_at(path: AbstractHodograph, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the distances [m] from the first of ascending, dense parameters `u` of one path with concrete values."""
    return np.append(0.0, np.cumsum(_lengths(path, u[:-1], u[1:])))


def _lengths(path: AbstractHodograph, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the distances travelled between parameters [m]."""
    half = 0.5 * (high - low)[:, None]
    return (half * WEIGHTS * paces(path, low[:, None] + half * (NODES + 1))).sum(axis=1)


def paces(path: AbstractHodograph, u: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
    """Return |r'| at the parameters `u` of one path with concrete values."""
    compute = in_numpy(_paces) if path.supports_numpy else _compiled_paces
    return np.asarray(compute(path, as_array(u.ravel(), path.duration.dtype))).reshape(u.shape)


def _paces(path: AbstractHodograph, u: Any) -> Any:
    return norm(path.sampled(u, 1)[1])


_compiled_paces = eqx.filter_jit(_paces)
