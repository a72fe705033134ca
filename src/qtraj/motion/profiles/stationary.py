"""Find the stationary points of a polynomial on the unit interval."""

import numpy as np
from numpy.polynomial import Polynomial


def stationary_points(curve: Polynomial) -> list[float]:
    """Return 0, the stationary points of a polynomial between 0 and 1 in ascending order, and 1."""
    slope = curve.deriv()
    # Leading coefficients below round-off would add spurious roots and make the true roots inexact.
    slope = slope.trim(float(np.finfo(float).eps * np.abs(slope.coef).max()))
    # Round-off may split a double root into a complex pair, so the real parts of complex roots are included.
    return [0.0, *(float(u) for u in np.sort(slope.roots().real) if 0 < u < 1), 1.0]
