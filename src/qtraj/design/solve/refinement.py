"""Solve the linear system of a Newton step accurately: conjugate gradients, preconditioned by its band factorisation.

The entries of the band matrix are sums of terms of very different size, above all with a limit on the jerk, so rounding
errors of its factors can exceed the small terms. The residual is computed from the terms themselves, without the sums.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Vectors = Float[np.ndarray, "batch n"]

STEPS = 8
"""Largest number of steps of conjugate gradients; with exact factors none is needed."""

ACCURACY = 1e-20
"""The steps end if the squared error in the norm of the matrix is below this fraction of the solution."""


def solve(product: Callable[[Vectors], Vectors], factors: Callable[[Vectors], Vectors], right: Vectors) -> Vectors:
    """Return the solutions x of `product`(x) = `right` for positive definite matrices; `factors` solves approximately.

    A problem whose residual does not decrease keeps its last solution.
    """
    x = factors(right)
    residual = right - product(x)
    conditioned = factors(residual)
    direction, size = conditioned, _dot(residual, conditioned)
    enough = ACCURACY * np.abs(_dot(right, x))
    for _ in range(STEPS):
        image = product(direction)
        curvature = _dot(direction, image)
        goes_on = (size > enough) & (curvature > 0)  # false for NaN
        if not goes_on.any():
            break
        step = np.where(goes_on, size / np.where(goes_on, curvature, 1.0), 0.0)[:, None]
        x = x + step * np.where(goes_on[:, None], direction, 0.0)
        residual = residual - step * image
        conditioned = factors(residual)
        before, size = size, np.where(goes_on, _dot(residual, conditioned), 0.0)
        direction = conditioned + (size / np.where(goes_on, before, 1.0))[:, None] * direction
    return x


def _dot(x: Vectors, y: Vectors) -> Float[np.ndarray, " batch"]:
    return np.einsum("bn,bn->b", x, y)
