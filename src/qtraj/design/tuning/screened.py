"""Starts that are the best of many random paths: those that exceed the limits least at a few instants.

Searches from such starts reach feasible paths far more often than from random starts. `python -m
benchmarks.tuning.hard` has problems for which no search from a planned start finds any feasible path.
"""

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.maxima import GRID
from qtraj.design.tuning.problem import DURATION
from qtraj.design.tuning.searches import Curves, Searches

RANDOM, CHOSEN = 4000, 48
"""Numbers of random paths, and of those that are starts."""

APART = 1.0
"""The smallest distance between two starts: the best of all random paths are often close to each other."""

SPREAD = 1.2
"""Standard deviation of the changes of the boundary velocities, in units of the reference speed."""

DURATIONS = (-1.5, 2.5)
"""Range of the changes of ln(duration), within the bounds."""

NODES = GRID[::4, None]
"""Fractions of the duration at which the limits are evaluated."""

SEED = 38


def screened_starts(searches: Searches) -> Float[np.ndarray, "n batch starts"]:
    """Return the best starts of each problem with constant limits; those that change along the way are ignored."""
    rng = np.random.default_rng(SEED)
    changes = SPREAD * rng.standard_normal((len(searches.low), RANDOM))
    fractions = rng.uniform(size=RANDOM)
    return np.stack([_best(searches.take([k]), changes, fractions) for k in range(searches.count)], axis=1)


def _best(one: Searches, changes: Float[np.ndarray, "n random"], fractions: Float[np.ndarray, " random"]) -> np.ndarray:
    """Return the starts (n, starts) of one problem."""
    z = changes.copy()
    if DURATION in one.problem.names:
        k = one.problem.names.index(DURATION)
        low, high = np.maximum(one.low[k], DURATIONS[0]), np.minimum(one.high[k], DURATIONS[1])
        z[k] = low + (high - low) * fractions
    z = np.clip(z, one.low, one.high)
    largest, chosen = _largest(one, z), []
    for _ in range(CHOSEN):
        chosen.append(int(np.argmin(largest)))
        near = np.sum((z - z[:, chosen[-1:]]) ** 2, axis=0) < APART**2
        largest = np.where(near, np.inf, largest)
    return z[:, chosen]


def _largest(one: Searches, z: Float[np.ndarray, "n random"]) -> Float[np.ndarray, " random"]:
    """Return the largest constraint values of many paths at the nodes."""
    largest = np.full(z.shape[1], ABSENT)
    many = one.take(np.zeros(z.shape[1], int))
    with np.errstate(all="ignore"):
        for g in Curves(many, z).values(tuple(one.limits), NODES, one.order):
            largest = np.maximum(largest, np.max(np.broadcast_to(g, (len(NODES), z.shape[1])), axis=0))
    return np.nan_to_num(largest, nan=np.inf, posinf=np.inf)
