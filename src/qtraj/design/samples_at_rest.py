"""Determine the values of samples of a retimed path at which the vehicle is at rest, and the stops."""

import numpy as np


def mended(values: np.ndarray, still: np.ndarray, standing: np.ndarray, vanishes: bool) -> np.ndarray:
    """Replace values at rest by 0 during a stop or if the quantity `vanishes`, otherwise by the nearest known value."""
    values = np.where(standing | (still & vanishes), 0.0, values)
    known = np.flatnonzero(np.isfinite(values) & ~(still & ~standing & (not vanishes)))
    if not known.size:
        return values
    missing = np.setdiff1d(np.arange(values.size), known)
    nearest = known[np.abs(known[None] - missing[:, None]).argmin(axis=1)] if missing.size else missing
    values[missing] = values[nearest]
    return values


def stops_of(times: np.ndarray, distance: np.ndarray, still: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the time intervals at rest (s, 2), and the distances (s,) [m] travelled up to these stops."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]))).reshape(-1, 2)
    return np.stack([times[edges[:, 0]], times[edges[:, 1] - 1]], axis=1), distance[edges[:, 0]]
