"""The covariance of the coefficients of a spiral-helix that was fitted to a recorded turn.

The parameters are the axis (x, y) and the ascending coefficients of the radius ρ, the azimuth φ and the height h. With
the Jacobian J of the residuals, each divided by its standard deviation, the covariance is s²(JᵀJ)⁻¹. s² is the sum of
the squared residuals divided by the degrees of freedom, because only the ratio of the standard deviations is known.
"""

from math import comb, factorial
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from qtraj.foundation.methods import method
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track, elapsed_times, to_float64


def sensitivities(path: SpiralHelix, t: Float[np.ndarray, " n"], order: int) -> Float[np.ndarray, "n {order}+1 3 p"]:
    """Return the derivatives of the position, and of its time derivatives up to `order`, by the parameters.

    The axis of the path is vertical. The Taylor series about each instant are multiplied in complex numbers x + iy.
    """
    radius, angle, height = (np.asarray(x, float) for x in (path.radius, path.angle, path.height))
    powers = _taylor_of_powers(max(map(len, (radius, angle, height))), t, order)
    outward = _exponential(np.tensordot(1j * angle, powers[: len(angle)], 1))
    from_axis = _product(np.tensordot(radius, powers[: len(radius)], 1), outward)
    result = np.zeros((order + 1, 3, 2 + len(radius) + len(angle) + len(height), len(t)))
    result[0, 0, 0] = result[0, 1, 1] = 1.0
    plane: list[Any] = [_product(x, outward) for x in powers[: len(radius)]]
    plane += [_product(x, 1j * from_axis) for x in powers[: len(angle)]]
    for k, terms in enumerate(plane, 2):
        result[:, 0, k], result[:, 1, k] = terms.real, terms.imag
    for k, terms in enumerate(powers[: len(height)], 2 + len(plane)):
        result[:, 2, k] = terms
    result *= np.array([factorial(k) for k in range(order + 1)])[:, None, None, None]
    return np.moveaxis(result, 3, 0)


def covariance_factor(path: SpiralHelix, track: Track, ratio: float) -> Float[np.ndarray, "p p"]:
    """Return a matrix F, such that FFᵀ is the covariance of the parameters of a fitted path in SI units.

    `ratio` [s] is the standard deviation of the positions divided by that of the velocities. NaN without degrees of
    freedom.
    """
    t, order = elapsed_times(track), int(track.velocities is not None)
    jacobian = sensitivities(path, t, order)
    recorded = [to_float64(x) for x in (track.positions, track.velocities) if x is not None]
    errors = np.stack([np.asarray(x) for x in method(path, "sampled")(t, order)[: order + 1]]) - np.stack(recorded)
    weights = np.array([1.0, ratio])[: order + 1]
    rows = (weights[:, None, None] * jacobian).reshape(-1, jacobian.shape[-1])
    squares = float(np.sum((weights[:, None, None] * errors) ** 2))
    free = rows.shape[0] - rows.shape[1]
    if free <= 0:
        return np.full((rows.shape[1],) * 2, np.nan)
    lengths = np.linalg.norm(rows, axis=0)
    _, values, axes = np.linalg.svd(rows / lengths, full_matrices=False)
    return np.sqrt(squares / free) * axes.T / values / lengths[:, None]


def _taylor_of_powers(terms: int, t: Float[np.ndarray, " n"], order: int) -> Float[np.ndarray, "terms {order}+1 n"]:
    """Return the Taylor coefficients about the times `t` of the powers of the time, from 0."""
    zero = np.zeros_like(t)
    return np.array([[comb(j, k) * t ** (j - k) if k <= j else zero for k in range(order + 1)] for j in range(terms)])


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.array([sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(len(b))])


def _exponential(x: Complex[np.ndarray, "terms n"]) -> Complex[np.ndarray, "terms n"]:
    """Return the Taylor coefficients of the exponential of a series."""
    result = [np.exp(x[0])]
    for k in range(1, len(x)):
        result.append(sum((m * x[m] * result[k - m] for m in range(1, k + 1)), 0 * x[0]) / k)
    return np.array(result)
