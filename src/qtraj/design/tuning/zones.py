"""Limits that change along the way, in a search: zones of the distance, in which a limit is constant or linear.

The constraint of a zone is the largest constraint value between two distances. While the variables change, so do the
times at which the path reaches these distances.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.along import Along
from qtraj.design.divisors import divisors
from qtraj.design.limits import Limits
from qtraj.design.tuning.targets import named_limits, target
from qtraj.path.quantity import quantity

if TYPE_CHECKING:
    from qtraj.design.tuning.searches import Curves

NODES, WEIGHTS = ((x + 1) / 2 if k == 0 else x / 2 for k, x in enumerate(np.polynomial.legendre.leggauss(8)))
PANELS, STEPS = 16, 16
"""Number of panels of the quadrature of the distance, and of steps of Newton's method for the time at a distance."""

WIDER = 1e-8
"""Zones of steps are wider than those of the limit by this fraction of the initial length at both ends: certificates
use the stricter value there, within the uncertainty of the distance."""

TIGHTER = 5e-7
"""Linear values are tighter by this fraction of the largest one, because a proof replaces them by stricter lines."""


class Zone(NamedTuple):
    """A zone of one limit: its distances [m] along the path, and the limit at both, in the units of the search."""

    name: str
    low: Float[np.ndarray, " batch"]
    high: Float[np.ndarray, " batch"]
    values: Float[np.ndarray, "2 batch"]

    @property
    def is_linear(self) -> bool:
        """Whether the limit changes inside the zone."""
        return bool((self.values[0] != self.values[1]).any())

    def take(self, index: Any) -> Zone:
        """Return the zones of some searches."""
        return Zone(self.name, self.low[index], self.high[index], self.values[:, index])

    def limit(self, distance: Float[np.ndarray, "*k batch"]) -> Float[np.ndarray, "*k batch"]:
        """Return the limit at distances [m] inside the zone."""
        return self.values[0] + self.slope * (distance - self.low)

    @property
    def slope(self) -> Float[np.ndarray, " batch"]:
        """The change of the limit per distance."""
        change = self.values[1] - self.values[0]
        return np.divide(change, self.high - self.low, out=np.zeros_like(change), where=change != 0)


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


def zones_of(limits: Limits, corridor: Any, count: int, length: Float[np.ndarray, " count"]) -> tuple[Zone, ...]:
    """Return the zones of the limits that change along the way; `length` [m] is that of the initial paths."""
    constant = {name: np.asarray(x, float) for name, x in (named_limits(limits, corridor) | limits.reduced()).items()}
    found = []
    for name in limits.varying:
        along: Any = limits.given()[name]
        if isinstance(along, Along):
            divisor = np.asarray(divisors([name], limits.road(float))[name], float)
            found += _zones(name, along, constant, divisor, count, length)
    return tuple(found)


def _zones(
    name: str, along: Along, constant: dict[str, Any], divisor: np.ndarray, count: int, length: np.ndarray
) -> list[Zone]:
    d, values = (np.asarray(x, float) for x in (along.distance, along.values))
    d, values = (np.broadcast_to(x, (count, x.shape[-1])).T for x in (d, values))
    entry, linear = quantity(name), along.kind == "linear"

    def value(x: np.ndarray) -> np.ndarray:
        bound = np.broadcast_to(entry.tangent(x) / divisor, (count,))
        return np.broadcast_to(target(name, constant | {name: bound}), (count,))

    if linear:
        values = values - entry.side * TIGHTER * np.abs(values).max(axis=0)
    ends = np.concatenate([d[1:], np.full((1, count), np.inf)])
    last = np.concatenate([values[1:], values[-1:]]) if linear else values
    wider = 0.0 if linear else WIDER * length
    return [
        Zone(name, np.where(low > 0, low - wider, 0.0), high + wider, np.stack([value(first), value(final)]))
        for low, high, first, final in zip(d, ends, values, last, strict=True)
        if np.isfinite(first).any()
    ]
