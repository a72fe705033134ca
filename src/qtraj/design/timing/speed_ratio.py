"""Ratios of accelerations to limits that depend on the speed, for the searches for paths and routes.

A search compares an acceleration to the limit at the speed of the same instant, so the speed is part of the constraint
and of its derivatives. The curve over the speed is rounded off at its kinks such that it is smooth and nowhere less
strict (see `timing.by_speed`); the exact limit is proved afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.algebra.jets import Jet
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import FIELDS, Ellipse, OfSpeed
from qtraj.design.timing.by_speed import curve_of
from qtraj.foundation.arrays import concrete
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity

ROUNDED = 1e-3
"""A kink is rounded off over this fraction of the shorter line next to it: if the speed of an optimum is at a kink, the
limits are stricter there than the exact ones by at most this order."""

SMALLEST = 0.5
"""The rounded curve is at least this multiple of the smallest limit, so that it is positive."""


class SpeedLimit:
    """A limit by speed relative to `size` [m/s²], as a function of the squared speed."""

    def __init__(self, limit: BySpeed, side: int, size: float = 1.0):
        """Store the rounded curve of a limit on one `side` that allows zero at every speed."""
        self._curve = curve_of(limit, np.ones((1, 1)), side, ROUNDED).scaled(1 / size)
        self._least = SMALLEST * abs(limit.strictest(side)) / size

    def __getitem__(self, index: Any) -> SpeedLimit:
        """Return the limit for some searches, which is the same for all of them."""
        return self

    def at(self, square: Any) -> Any:
        """Return the relative limit at a squared speed [m²/s²], a jet or an array; for a jet, a jet."""
        if isinstance(square, jax.Array):
            return self._differentiable(square)
        return _applied(square, self.values(value_of(square)))

    def values(self, square: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the relative limit, and its first and second derivatives with respect to the squared speed."""
        square = np.asarray(square)
        value, *derivatives = (x.reshape(square.shape) for x in self._curve.values(square.reshape(1, -1)))
        low = value < self._least
        return np.where(low, self._least, value), *(np.where(low, 0.0, x) for x in derivatives)  # type: ignore[return-value]

    def _differentiable(self, square: Any) -> Any:
        """Return the relative limit at squared speeds (nodes, n) as a function that JAX differentiates."""
        value = self._curve.in_jax(square)
        return jnp.where(value < self._least, self._least, value)


class SpeedEllipse:
    """The limit on the combined acceleration, whose half-axes may depend on the speed."""

    def __init__(self, limit: Ellipse):
        """Store the rounded curves of the half-axes."""
        self._braking, self._accelerating, self._lateral = (SpeedLimit(getattr(limit, name), 1) for name in FIELDS)

    def __getitem__(self, index: Any) -> SpeedEllipse:
        """Return the limit for some searches, which is the same for all of them."""
        return self

    def square(self, i: Invariants, square: Any) -> Any:
        """Return (a_τ/x)² + (a_n/y)² in the units of `i`; `square` is the squared speed [m²/s²]."""
        v2, ahead = value_of(square), value_of(i.B) > 0
        if isinstance(v2, jax.Array):
            along = i.B / jnp.where(ahead, self._accelerating.at(v2), self._braking.at(v2))
            return (along * along + i.N / self._lateral.at(v2) ** 2) / i.S
        each = zip(self._accelerating.values(v2), self._braking.values(v2), strict=True)
        x, y = _applied(square, tuple(np.where(ahead, p, q) for p, q in each)), self._lateral.at(square)
        along = i.B / x
        return (along * along + i.N / (y * y)) / i.S


WithSpeed = SpeedLimit | SpeedEllipse
"""A limit that depends on the speed, as searches impose it."""


def with_speed(name: str, limit: Any, size: float = 1.0) -> WithSpeed | None:
    """Return how a limit depends on the speed, relative to its `size`; None if it does not."""
    if isinstance(limit, Ellipse):
        return SpeedEllipse(limit)
    return SpeedLimit(limit, quantity(name).side, size) if isinstance(limit, BySpeed) else None


def all_with_speed(limits: Mapping[str, Any], sizes: Any) -> tuple[WithSpeed | None, ...] | None:
    """Return how each of the `limits` depends on the speed, relative to `sizes`; None if none does."""
    if not any(isinstance(x, OfSpeed) for x in limits.values()):
        return None
    return tuple(with_speed(name, x, abs(size)) for (name, x), size in zip(limits.items(), sizes, strict=True))


def require_zero_allowed(limits: Mapping[str, Any], what: str) -> None:
    """Raise a ValueError, in the name of `what`, for a limit by speed that does not allow zero at every speed."""
    for name, limit in limits.items():
        if isinstance(limit, BySpeed):
            known, side = concrete(limit.values), quantity(name).side
            if known is not None and not (side * known > 0).all():
                raise ValueError(
                    f"{what} needs two-sided limits that allow zero at every speed, with a lower bound below and an "
                    f"upper bound above it, but {name} = {known.tolist()} was given: pass other values, or retime a "
                    "route with this limit"
                )


def value_of(x: Any) -> Any:
    """Return the value of a jet, or an array."""
    return x.value if isinstance(x, Jet) else x


def _applied(x: Any, values: tuple[Any, ...]) -> Any:
    """Return a function of `x`, a jet or an array, from its values and its first and second derivatives."""
    return x.apply(*values) if isinstance(x, Jet) else values[0]
