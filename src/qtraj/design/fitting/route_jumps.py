"""Jumps of recorded positions: how far a sample is from where the velocities of its neighbours would put it."""

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.fitting.route_choice import Recording

NEIGHBOURS = 5
"""Number of consecutive velocities whose median is the usual velocity."""

LONG_STEP = 4.0
"""A time step longer than this factor times the median is a gap, across which a jump cannot be recognised."""

JUMP_RATIO, BACK, LONGEST = 20.0, 0.25, 0.1
"""Minimum size of a jump relative to the median jump, tolerance on a jump back relative to the jump, and the largest
number of samples between them relative to all samples."""

MIN_SCALE = 1e-8
"""[m] Lower bound on distances, so that rounding errors do not turn noiseless samples into outliers."""


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths (n,) of vectors (n, 3); faster than `numpy.linalg.norm`."""
    return np.sqrt(np.einsum("nk,nk->n", vectors, vectors))


def jumps(recording: Recording) -> Float[np.ndarray, "steps 3"]:
    """Return the jump from each sample to the next: the change of position without the usual velocity [m].

    With standard deviations, the jumps are multiplied by the square roots of the weights, as residuals are.
    """
    steps = np.diff(recording.times)[:, None]
    velocities = np.diff(recording.positions, axis=0) / steps
    reach = min(NEIGHBOURS // 2, len(velocities) - 1)
    padded = np.pad(velocities, ((reach, reach), (0, 0)), mode="reflect")
    usual = np.median(np.stack([padded[k : k + len(velocities)] for k in range(2 * reach + 1)]), axis=0)
    found = (velocities - usual) * steps
    found[steps[:, 0] > LONG_STEP * recording.step] = 0.0
    return recording.position_sigmas.part(slice(1, None)).scaled(found)


def displaced(jumps: Float[np.ndarray, "steps 3"]) -> Bool[np.ndarray, " n"]:
    """Return a mask of samples that may be displaced together, between a jump and an equal jump back."""
    marked = np.zeros(len(jumps) + 1, bool)
    sizes = lengths(jumps)
    last = -1
    places = np.flatnonzero(sizes > JUMP_RATIO * max(float(np.median(sizes)), MIN_SCALE))
    for k, start in enumerate(places):
        if start <= last:
            continue
        ends = places[k + 1 :]
        ends = ends[ends - start <= len(marked) * LONGEST]
        back = ends[lengths(jumps[ends] + jumps[start]) < BACK * sizes[start]]
        if len(back):
            last = back[0]
            marked[start + 1 : last + 1] = True
    return marked
