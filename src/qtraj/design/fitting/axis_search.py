"""Where the vertical axis of a recorded turn may stand: starts for the least squares of `fit`.

Once an axis is chosen, the radii and azimuths of the samples are known, and the polynomials of ρ and φ follow
linearly. So the whole plane about the track is searched, in polar steps about its centre. Starts are the best place and
the next best ones away from it, so that which axis the fit finds is no matter of luck.
"""

import numpy as np

SAMPLES = 256
"""The search looks at about so many samples, evenly spread."""

RINGS, RAYS = 36, 72
"""Polar grid of axes about the centre of the track; rings are spaced geometrically."""

STARTS, APART = 8, 0.25
"""So many places are handed to the least squares, apart from each other by this part of the lesser radius."""


def starts(positions: np.ndarray, basis: np.ndarray, angle_terms: int, bounds: tuple[float, float]) -> list[np.ndarray]:
    """Vectors (x, y, ρ coefficients, φ coefficients) to start from, most promising first.

    `positions` (n, 2) about their centre; `basis` (n, terms) holds the values of the basis polynomials at the samples,
    of which φ uses the first `angle_terms`; `bounds` are those of the radius, in the units of the positions.
    """
    stride = max(1, len(positions) // SAMPLES)
    positions, basis = positions[::stride], basis[::stride]
    axes = _grid(positions, bounds)
    cost = _misfit(axes, positions, basis, angle_terms, bounds)
    return [_start(axis, positions, basis, angle_terms) for axis in _spread(axes, cost, positions)]


def _grid(positions: np.ndarray, bounds: tuple[float, float]) -> np.ndarray:
    extent = np.hypot(*positions.T).max()
    rings = np.geomspace(bounds[0] / 4, bounds[1] + extent, RINGS)
    rays = np.arange(RAYS) * 2 * np.pi / RAYS
    return np.stack([np.outer(rings, np.cos(rays)).ravel(), np.outer(rings, np.sin(rays)).ravel()], axis=1)


def _misfit(
    axes: np.ndarray, positions: np.ndarray, basis: np.ndarray, angle_terms: int, bounds: tuple[float, float]
) -> np.ndarray:
    """Mean square distance between the samples and the best polynomials about each axis, and what breaks the bounds."""
    radius, angle = _polar(axes[:, None, :], positions)
    off = _remainder(radius, basis) ** 2 + (radius * _remainder(angle, basis[:, :angle_terms])) ** 2
    excess = np.maximum(bounds[0] - radius, 0) + np.maximum(radius - bounds[1], 0)
    return np.mean(off + excess**2, axis=1)


def _start(axis: np.ndarray, positions: np.ndarray, basis: np.ndarray, angle_terms: int) -> np.ndarray:
    radius, angle = _polar(axis, positions)
    of_radius = np.linalg.lstsq(basis, radius, rcond=None)[0]
    of_angle = np.linalg.lstsq(basis[:, :angle_terms], angle, rcond=None)[0]
    return np.concatenate([axis, of_radius, of_angle])


def _polar(axes: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.moveaxis(positions - axes, -1, 0)
    return np.hypot(x, y), np.unwrap(np.arctan2(y, x), axis=-1)


def _remainder(values: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """What the span of the basis leaves of each row of values."""
    q, _ = np.linalg.qr(basis)
    return values - (values @ q) @ q.T


def _spread(axes: np.ndarray, cost: np.ndarray, positions: np.ndarray) -> list[np.ndarray]:
    """The cheapest axis, then the cheapest that is apart from all before, and so on."""
    distance = np.sqrt(np.mean(np.sum((axes[:, None] - positions) ** 2, axis=2), axis=1))
    chosen: list[np.ndarray] = []
    free = np.isfinite(cost)
    while len(chosen) < STARTS and free.any():
        k = int(np.argmin(np.where(free, cost, np.inf)))
        chosen.append(axes[k])
        free &= np.hypot(*(axes - axes[k]).T) > APART * np.minimum(distance, distance[k])
    return chosen
