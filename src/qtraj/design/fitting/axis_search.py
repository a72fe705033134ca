"""Compute starting points for the least-squares problem of `fit` by a grid search for the vertical axis of a turn.

If the axis is fixed, the radii and azimuths of the samples are known, and linear least squares gives the polynomials of
the radius ρ and the azimuth φ. The search is therefore only over the axis, on a polar grid about the centre of the
track. Several axes at a minimum distance from each other are chosen, so that the fit does not depend on a single start.
"""

import numpy as np

SAMPLES = 256
"""Only every k-th of n samples is used, with k = max(1, n // SAMPLES)."""

RINGS, RAYS = 36, 72
"""Numbers of rings and rays of the polar grid of axes about the centre of the track.

The radii of the rings are a geometric sequence.
"""

MAX_STARTS, MIN_DISTANCE = 8, 0.25
"""Maximum number of starts, and the minimum distance between two axes.

The distance is relative to the smaller of the RMS distances of the samples from the two axes.
"""


def starts(positions: np.ndarray, basis: np.ndarray, angle_terms: int, bounds: tuple[float, float]) -> list[np.ndarray]:
    """Return the starting points, best first, each as one vector: x and y of the axis, coefficients of ρ and of φ.

    `positions` (n, 2) are relative to the centre of the window. `basis` (n, terms) contains the values of the basis
    polynomials at the samples; φ uses the first `angle_terms` polynomials. `bounds` are the minimum and maximum radius,
    in the units of the positions.
    """
    stride = max(1, len(positions) // SAMPLES)
    positions, basis = positions[::stride], basis[::stride]
    axes = _grid(positions, bounds)
    cost = _mean_square_misfit(axes, positions, basis, angle_terms, bounds)
    return [_start(axis, positions, basis, angle_terms) for axis in _select(axes, cost, positions)]


def _grid(positions: np.ndarray, bounds: tuple[float, float]) -> np.ndarray:
    extent = np.hypot(*positions.T).max()
    rings = np.geomspace(bounds[0] / 4, bounds[1] + extent, RINGS)
    rays = np.arange(RAYS) * 2 * np.pi / RAYS
    return np.stack([np.outer(rings, np.cos(rays)).ravel(), np.outer(rings, np.sin(rays)).ravel()], axis=1)


def _mean_square_misfit(
    axes: np.ndarray, positions: np.ndarray, basis: np.ndarray, angle_terms: int, bounds: tuple[float, float]
) -> np.ndarray:
    """Return the mean square distance of the samples from the best path about each axis, plus a penalty.

    The penalty is the mean squared violation of `bounds` by the radii of the samples.
    """
    radius, angle = _polar(axes[:, None, :], positions)
    errors = _residual(radius, basis) ** 2 + (radius * _residual(angle, basis[:, :angle_terms])) ** 2
    violation = np.maximum(bounds[0] - radius, 0) + np.maximum(radius - bounds[1], 0)
    return np.mean(errors + violation**2, axis=1)


def _start(axis: np.ndarray, positions: np.ndarray, basis: np.ndarray, angle_terms: int) -> np.ndarray:
    radius, angle = _polar(axis, positions)
    radius_coefficients = np.linalg.lstsq(basis, radius, rcond=None)[0]
    angle_coefficients = np.linalg.lstsq(basis[:, :angle_terms], angle, rcond=None)[0]
    return np.concatenate([axis, radius_coefficients, angle_coefficients])


def _polar(axes: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.moveaxis(positions - axes, -1, 0)
    return np.hypot(x, y), np.unwrap(np.arctan2(y, x), axis=-1)


def _residual(values: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return the residuals of `values` (…, n) after projection onto the columns of `basis` (n, terms)."""
    q, _ = np.linalg.qr(basis)
    return values - (values @ q) @ q.T


def _select(axes: np.ndarray, cost: np.ndarray, positions: np.ndarray) -> list[np.ndarray]:
    """Return the best axis, then repeatedly the best axis that is far enough from all selected axes."""
    distance = np.sqrt(np.mean(np.sum((axes[:, None] - positions) ** 2, axis=2), axis=1))
    chosen: list[np.ndarray] = []
    available = np.isfinite(cost)
    while len(chosen) < MAX_STARTS and available.any():
        k = int(np.argmin(np.where(available, cost, np.inf)))
        chosen.append(axes[k])
        available &= np.hypot(*(axes - axes[k]).T) > MIN_DISTANCE * np.minimum(distance, distance[k])
    return chosen
