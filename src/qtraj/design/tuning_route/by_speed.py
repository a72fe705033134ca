"""Limits that depend on the speed, as constraints of the search for a route.

The limit at a node is that at the speed of the node, so the speed is part of the constraint and of its derivatives. The
curve over the speed is rounded off at its kinks such that it is smooth and nowhere less strict (see `timing.by_speed`);
the exact limit is proved afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.algebra.jets import Jet
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import FIELDS, Ellipse, OfSpeed
from qtraj.design.timing.by_speed import Curve, curve_of
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity

SMALLEST = 0.5
"""The rounded curve is at least this multiple of the smallest limit, so that a ratio to it is positive."""


class SpeedLimit:
    """A limit by speed relative to `size`, its strictest value, as a function of the squared speed."""

    def __init__(self, limit: BySpeed, side: int, size: float):
        """Store the rounded curve of a limit on one `side` that is nowhere zero."""
        self.curve: Curve = curve_of(limit, np.ones((1, 1)), side).scaled(1 / size)
        self.least = SMALLEST * abs(limit.strictest(side)) / size

    def values(self, square: Any) -> tuple[Any, Any, Any]:
        """Return the relative limit, and its first and second derivatives with respect to the squared speed."""
        value, first, second = self.curve.values(square)
        low = value < self.least
        return np.where(low, self.least, value), np.where(low, 0.0, first), np.where(low, 0.0, second)


class SpeedEllipse:
    """The limit on the combined acceleration, whose half-axes may depend on the speed."""

    def __init__(self, limit: Ellipse):
        """Store the rounded curves of the half-axes."""
        self.braking, self.accelerating, self.lateral = (SpeedLimit(getattr(limit, name), 1, 1.0) for name in FIELDS)

    def square(self, i: Invariants, h: Any) -> Any:
        """Return (a_τ/x)² + (a_n/y)² for derivatives in the unit of time `h`."""
        a = squared_speed(i, h)
        ahead = value_of(i.B) > 0
        each = zip(self.accelerating.values(value_of(a)), self.braking.values(value_of(a)), strict=True)
        x = applied(a, tuple(np.where(ahead, p, q) for p, q in each))
        y = applied(a, self.lateral.values(value_of(a)))
        inverse = 1.0 / (h * h)
        return ((i.B / x) * (i.B / x) + i.N / (y * y)) / i.S * (inverse * inverse)


OfNodes = SpeedLimit | SpeedEllipse | None
"""How a limit depends on the speed at a node; None for a limit that does not."""


def of_nodes(limits: Mapping[str, Any], sizes: Any) -> tuple[OfNodes, ...] | None:
    """Return how each of the `limits` depends on the speed, relative to `sizes`; None if none does."""
    if not any(isinstance(x, OfSpeed) for x in limits.values()):
        return None
    return tuple(_of_node(name, x, abs(size)) for (name, x), size in zip(limits.items(), sizes, strict=True))


def _of_node(name: str, limit: Any, size: float) -> OfNodes:
    if isinstance(limit, Ellipse):
        return SpeedEllipse(limit)
    return SpeedLimit(limit, quantity(name).side, size) if isinstance(limit, BySpeed) else None


def squared_speed(i: Invariants, h: Any) -> Any:
    """Return the squared speed [m²/s²] for derivatives in the unit of time `h` [s]."""
    return i.S / (h * h)


def applied(a: Any, values: tuple[Any, Any, Any]) -> Any:
    """Return a function of `a`, a jet or an array, from its values and its first and second derivatives."""
    return a.apply(*values) if isinstance(a, Jet) else values[0]


def relative_limit(limit: SpeedLimit, i: Invariants, h: Any) -> Any:
    """Return the limit at the speed, relative to its `size`."""
    a = squared_speed(i, h)
    return applied(a, limit.values(value_of(a)))


def value_of(a: Any) -> Any:
    """Return the value of a jet, or an array."""
    return a.value if isinstance(a, Jet) else a
