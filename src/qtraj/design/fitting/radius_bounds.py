"""Bounds of the radius ρ on a whole fitted path."""

import numpy as np
from numpy.polynomial import Polynomial

BOUND_TOLERANCE = 1e-3
"""A radius within this relative distance of a bound counts as at the bound."""

MARGIN = 1e-9
"""Relative distance that `shrink_into_bounds` keeps from the bounds, so that rounding errors cannot violate them."""

MAX_IMAGINARY = 1e-12
"""A root counts as real if the magnitude of its imaginary part, divided by the duration, is below this value."""

Bounds = tuple[float, float]


def extremes(radius: np.ndarray, duration: float) -> Bounds:
    """Return the minimum and maximum of ρ [m] on [0, `duration`] [s].

    `radius` contains the coefficients of ρ for ascending powers of the time t.
    """
    rho = Polynomial(radius)
    stationary = rho.deriv().roots()
    inner = stationary.real[
        (abs(stationary.imag) < MAX_IMAGINARY * duration) & (stationary.real > 0) & (stationary.real < duration)
    ]
    values = rho(np.array([0.0, duration, *inner]))
    return float(values.min()), float(values.max())


def shrink_into_bounds(radius: np.ndarray, duration: float, bounds: Bounds) -> np.ndarray:
    """Return the coefficients of ρ, scaled towards the middle of the bounds if ρ violates a bound somewhere.

    The scale factor is the largest with which ρ satisfies both bounds everywhere, reduced by the relative `MARGIN`.
    """
    minimum, maximum = extremes(radius, duration)
    if bounds[0] <= minimum and maximum <= bounds[1]:
        return radius
    middle = (bounds[0] + bounds[1]) / 2
    factor = (bounds[1] - middle) * (1 - MARGIN) / max(middle - minimum, maximum - middle)
    return radius * factor + np.eye(1, len(radius))[0] * middle * (1 - factor)


def is_at_bound(radius: np.ndarray, duration: float, bounds: Bounds) -> bool:
    """Check whether ρ reaches one of its bounds."""
    minimum, maximum = extremes(radius, duration)
    return minimum < bounds[0] * (1 + BOUND_TOLERANCE) or maximum > bounds[1] * (1 - BOUND_TOLERANCE)
