"""Limits that are tightened by margins."""

import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits, limits_of
from qtraj.design.robust.driven import bounds_of
from qtraj.path.quantity import quantity

REMAINING = 0.02
"""A tightened limit is at least this part of the limit."""


def tightened(limits: Limits, margins: Float[np.ndarray, " k"]) -> Limits | None:
    """Return the limits minus their margins, or None if almost nothing remains of one of them."""
    names = tuple(limits.given())
    bounds, sides, _ = bounds_of(limits)
    tight = bounds - sides * margins
    magnitudes = np.array([not quantity(name).lower and bound > 0 for name, bound in zip(names, bounds, strict=True)])
    if not np.isfinite(tight).all() or (magnitudes & (tight < REMAINING * bounds)).any():
        return None
    try:
        return limits_of(dict(zip(names, tight.tolist(), strict=True)), limits.vehicle)
    except ValueError:  # the lower bound is above the upper one
        return None
