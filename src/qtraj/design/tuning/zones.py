"""Limits that change in a search: zones of the distance, in which a limit is constant, linear, or depends on the speed.

The constraint of a zone is the largest constraint value between two distances. While the variables change, so do the
times at which the path reaches these distances.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.along import Along
from qtraj.design.divisors import divisors, reduced as reduced_limits
from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.timing.speed_ratio import WithSpeed, with_speed
from qtraj.design.tuning.targets import named_limits, target
from qtraj.path.quantity import quantity

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


class SpeedZone(NamedTuple):
    """A limit that depends on the speed: one zone over the whole path, with the same fields as `Zone`."""

    name: str
    low: Float[np.ndarray, " batch"]
    high: Float[np.ndarray, " batch"]
    values: tuple[WithSpeed]
    is_linear: bool = False

    def take(self, index: Any) -> SpeedZone:
        """Return the zones of some searches."""
        return self._replace(low=self.low[index], high=self.high[index])

    def limit(self, distance: Float[np.ndarray, "*k batch"]) -> WithSpeed:
        """Return the limit, which does not depend on the distance [m]."""
        return self.values[0]


AnyZone = Zone | SpeedZone


def zones_of(limits: Limits, corridor: Any, count: int, length: Float[np.ndarray, " count"]) -> tuple[AnyZone, ...]:
    """Return the zones of the limits that change along the way; `length` [m] is that of the initial paths."""
    constant = {
        name: np.asarray(x, float) for name, x in (named_limits(limits, corridor) | reduced_limits(limits)).items()
    }
    found: list[AnyZone] = []
    for name in limits.varying:
        along: Any = limits.given()[name]
        if isinstance(along, Along):
            divisor = np.asarray(divisors([name], limits.road(float))[name], float)
            found += _zones(name, along, constant, divisor, count, length)
        elif isinstance(along, OfSpeed):
            limit: Any = with_speed(name, along.scaled(1 - TIGHTER))
            found.append(SpeedZone(name, np.zeros(count), np.full(count, np.inf), (limit,)))
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
