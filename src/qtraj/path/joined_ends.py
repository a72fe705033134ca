"""Decide whether a path ends as it starts, as a closed curve and a lap do."""

import numpy as np
from jaxtyping import Float

JOINED = 1e-6
"""Largest difference of r, r' and r'' between the ends, relative to the sizes of these vectors along the path."""


def first_difference(states: Float[np.ndarray, "n orders 3"], duration: float) -> int | None:
    """Return the lowest order of a derivative that differs at the ends of a path, or None if none does.

    `states` contain r and its derivatives at n instants, from the start to the end.
    """
    gaps = np.linalg.norm(states[-1] - states[0], axis=1)
    moved = states.copy()
    moved[:, 0] -= states[0, 0]
    sizes = np.abs(moved).max(axis=(0, 2))
    different = gaps > JOINED * np.maximum(sizes, sizes[0] / duration ** np.arange(len(gaps)))
    return int(np.argmax(different)) if different.any() else None
