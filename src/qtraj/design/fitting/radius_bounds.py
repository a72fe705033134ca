"""The bounds of ρ on a whole fitted path."""

import numpy as np
from numpy.polynomial import Polynomial

HELD = 1e-3
"""A radius within this part of a bound is held by it."""

MARGIN = 1e-9
"""A radius that was outside is drawn inside by this part of its bounds: rounding does not lead out again."""

REAL = 1e-12
"""Imaginary part below which a root is real, in durations."""

Bounds = tuple[float, float]


def extremes(radius: np.ndarray, duration: float) -> Bounds:
    """The least and the largest ρ [m] of a path with these ascending coefficients and duration [s]."""
    rho = Polynomial(radius)
    turning = rho.deriv().roots()
    between = turning.real[(abs(turning.imag) < REAL * duration) & (turning.real > 0) & (turning.real < duration)]
    values = rho(np.array([0.0, duration, *between]))
    return float(values.min()), float(values.max())


def inside(radius: np.ndarray, duration: float, bounds: Bounds) -> np.ndarray:
    """The coefficients of ρ, drawn towards the middle of its bounds as far as it takes to be inside everywhere."""
    least, largest = extremes(radius, duration)
    if bounds[0] <= least and largest <= bounds[1]:
        return radius
    middle = (bounds[0] + bounds[1]) / 2
    part = (bounds[1] - middle) * (1 - MARGIN) / max(middle - least, largest - middle)
    return radius * part + np.eye(1, len(radius))[0] * middle * (1 - part)


def held(radius: np.ndarray, duration: float, bounds: Bounds) -> bool:
    """Whether ρ is held by a bound."""
    least, largest = extremes(radius, duration)
    return least < bounds[0] * (1 + HELD) or largest > bounds[1] * (1 - HELD)
