"""Limits that change along the way, as functions of the parameter of the path that is timed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.along import Along
from qtraj.foundation.arrays import is_traced
from qtraj.path.distances import Distances, distances
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity

Parameters = Float[np.ndarray, "*n"]


class Varying:
    """A limit that changes along one path; `side` is −1 for a lower bound, and otherwise 1."""

    def __init__(self, along: Along, on: Distances, side: int):
        self.along, self.on, self.side = along, on, side

    @property
    def values(self) -> Float[np.ndarray, " steps"]:
        """All values on the path; infinite where there is no limit."""
        used = np.asarray(self.along.distance) < self.on.length
        return np.asarray(self.along.values, float)[used]

    @property
    def strictest(self) -> Any:
        """The strictest value on the whole path."""
        return self.side * np.min(self.side * self.values)

    def scaled(self, factor: float) -> Varying:
        """Return the limit multiplied by `factor`."""
        return Varying(self.along.scaled(factor), self.on, self.side)

    def between(self, low: Parameters, high: Parameters) -> Parameters:
        """Return the strictest values between parameters of the path."""
        first, last = (self.on.at(np.ravel(x)) for x in (low, high))
        error = self.on.uncertainty
        return np.asarray(self.along.strictest(first - error, last + error, self.side)).reshape(np.shape(low))

    def at(self, u: Parameters) -> Parameters:
        """Return the values at parameters of the path; where the value changes, the later one."""
        return np.asarray(self.along.at(self.on.at(np.ravel(u)))).reshape(np.shape(u))

    def changes(self) -> Float[np.ndarray, " m"]:
        """Return the distances [m] at which a step or a linear piece ends, on the path."""
        d = np.asarray(self.along.distance, float)[1:]
        return d[d < self.on.length]


Bounds = Mapping[str, Any]
"""Limits by name: numbers, or `Varying`."""


def on_path(bounds: Bounds, path: AbstractHodograph) -> dict[str, Any]:
    """Return the limits on a path; each `Along` becomes a `Varying`.

    **Raises:** ValueError for traced values that change along the way, or a traced path with such values.
    """
    changing = [name for name, x in bounds.items() if isinstance(x, Along)]
    if not changing:
        return dict(bounds)
    if is_traced(path, [bounds[name] for name in changing]):
        raise ValueError(
            f"the limit {changing[0]} changes along the way, which retime supports only for a path and limits with "
            "concrete values: call it outside jit, grad and vmap"
        )
    on = distances(path)
    return {name: Varying(x, on, quantity(name).side) if name in changing else x for name, x in bounds.items()}


def varies(bounds: Bounds) -> bool:
    """Return whether a limit changes along the way."""
    return any(isinstance(x, Varying) for x in bounds.values())


def strictest_between(bounds: Bounds, low: Any, high: Any) -> dict[str, Any]:
    """Return the limits with the strictest values between parameters of the path in the place of each `Varying`."""
    return {name: x.between(low, high) if isinstance(x, Varying) else x for name, x in bounds.items()}


def at(bounds: Bounds, u: Parameters) -> dict[str, Any]:
    """Return the limits with the values at parameters of the path in the place of each `Varying`."""
    return {name: x.at(u) if isinstance(x, Varying) else x for name, x in bounds.items()}


def strictest(bounds: Bounds) -> dict[str, Any]:
    """Return the limits with the strictest values on the whole path."""
    return {name: x.strictest if isinstance(x, Varying) else x for name, x in bounds.items()}


def chosen(bounds: Bounds, k: Any) -> dict[str, Any]:
    """Return the limits for some cells; arrays of limits contain one value for each cell."""
    return {name: x[k] if np.ndim(x) else x for name, x in bounds.items()}


def all_values(bound: Any) -> Any:
    """Return the value, or all finite values, of a limit."""
    values = bound.values if isinstance(bound, Varying | Along) else bound
    return np.asarray(values)[np.isfinite(values)] if isinstance(bound, Varying | Along) else values
