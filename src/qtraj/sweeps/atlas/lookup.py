"""Where points of the plane lie in the leaves of an atlas."""

import numpy as np
from jaxtyping import Float, Int

from qtraj.sweeps.atlas.quadtree import CORNERS


def nearest_corner(lattice: Int[np.ndarray, "n 2"], leaves: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 4"]:
    """Return the indices of the points at the corners of each leaf, counterclockwise."""
    width = int(lattice[:, 1].max()) + 1
    keys = lattice[:, 0] * width + lattice[:, 1]
    order = np.argsort(keys)
    four = leaves[:, None, :2] + leaves[:, None, 2:] * np.array(CORNERS)
    return order[np.searchsorted(keys, four[..., 0] * width + four[..., 1], sorter=order)]


def containing(leaves: Int[np.ndarray, "m 3"], points: Float[np.ndarray, "k 2"]) -> Int[np.ndarray, " k"]:
    """Return the index of a leaf that contains each point, in units of the lattice; the leaves cover all points."""
    ends = leaves[:, :2] + leaves[:, 2:]
    width = int(ends[:, 1].max()) + 1
    inner = np.minimum(np.floor(points).astype(np.int64), ends.max(axis=0) - 1)
    found = np.zeros(len(points), np.int64)
    for size in np.unique(leaves[:, 2]):
        these = np.flatnonzero(leaves[:, 2] == size)
        keys = leaves[these, 0] * width + leaves[these, 1]  # increasing, because leaves are in order
        start = inner // size * size
        wanted = start[:, 0] * width + start[:, 1]
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        found = np.where(keys[place] == wanted, these[place], found)
    return found


def interpolated(
    lattice: Int[np.ndarray, "n 2"], leaves: Int[np.ndarray, "m 3"], points: Float[np.ndarray, "k 2"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 4"], Int[np.ndarray, "k 4"]]:
    """Return, for points in units of the lattice, the nearest corner, and the bilinear weights of the four corners."""
    leaf = leaves[containing(leaves, points)]
    four = nearest_corner(lattice, leaf)
    inside = (points - leaf[:, :2]) / leaf[:, 2:]
    towards = np.array(CORNERS)
    weights = np.prod(np.where(towards == 1, inside[:, None], 1 - inside[:, None]), axis=-1)
    return four[np.arange(len(four)), np.argmax(weights, axis=1)], weights, four
