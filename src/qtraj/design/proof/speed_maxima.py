"""Find where quantities are nearest to limits that depend on the speed, or violate them most."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.design.proof.findings import Limit
from qtraj.design.proof.maxima import find_maxima
from qtraj.design.proof.sources import Source
from qtraj.design.proof.speed_claims import compared
from qtraj.foundation.namespace import xp


def nearest_to_limit(
    at: Callable[[np.ndarray], Any], grid: np.ndarray, source: Source, limit: Limit, hints: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the instants at which a quantity is nearest to its limit or violates it most, and the values there.

    `at` returns the invariants at fractions of the duration, and `hints` are fractions near which to look.
    """

    def function(u: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            value, bound = compared_at(at(u), source, limit)
            return xp.broadcast_to(limit.entry.side * (value - bound), (len(u), source.count))

    found, _ = find_maxima(function, grid, function(grid), None if hints is None else hints[None])
    with np.errstate(all="ignore"):
        return found, compared_at(at(found[None]), source, limit)[0][0]


def compared_at(i: Any, source: Source, limit: Limit) -> tuple[Any, Any]:
    """Return the values of the quantity and its limits in SI units, from invariants in the units of the `source`."""
    h, length = source.duration, source.length
    return compared(i, limit.entry.name, limit.by_speed, (length / h, length / h**2))  # type: ignore[arg-type]
