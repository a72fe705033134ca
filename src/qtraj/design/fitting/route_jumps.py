"""Jumps of recorded positions: how far a sample is from where the velocities of its neighbours would put it."""

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.fitting.recording import Recording

LONG_STEP = 4.0
"""A time step longer than this factor times the median is a gap, across which a jump cannot be recognised."""

JUMP_RATIO, BACK, LONGEST = 20.0, 0.25, 0.1
"""Minimum size of a jump relative to the median jump, tolerance on a jump back relative to the jump, and the largest
number of samples between them relative to all samples."""

MIN_SCALE = 1e-9
"""Lower bound on distances, in units of length, so that rounding errors do not turn noiseless samples into outliers."""


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths (n,) of vectors (n, 3); faster than `numpy.linalg.norm`."""
    return np.sqrt(np.einsum("nk,nk->n", vectors, vectors))


def jumps(recording: Recording) -> Float[np.ndarray, "steps 3"]:
    """Return the jump from each sample to the next: the change of position that neighbouring velocities do not explain.

    The velocities before and after a step are extrapolated and interpolated; the median of the three predictions is
    used, because one of the velocities may be wrong. With standard deviations, the jumps are multiplied by the square
    roots of the weights, as residuals are.
    """
    steps = np.diff(recording.times)[:, None]
    velocities = np.diff(recording.positions, axis=0) / steps
    padded = np.pad(velocities, ((2, 2), (0, 0)), constant_values=np.nan)
    earlier, before, after, later = (padded[k : k + len(velocities)] for k in (0, 1, 3, 4))
    predictions = np.stack([2 * before - earlier, (before + after) / 2, 2 * after - later])
    expected = _median_of_known(predictions, velocities)
    found = (velocities - expected) * steps
    found[steps[:, 0] > LONG_STEP * recording.step] = 0.0
    later = np.arange(len(recording.times)) > 0
    return recording.position_sigmas.part(later).scaled(found)


def _median_of_known(predictions: Float[np.ndarray, "3 n 3"], otherwise: np.ndarray) -> np.ndarray:
    """Return the median of the predictions that are not NaN; without any, `otherwise`."""
    known = ~np.isnan(predictions[:, :, 0]).all(axis=0)
    result = otherwise.copy()
    result[known] = np.nanmedian(predictions[:, known], axis=0)
    return result


def at_rest(recording: Recording) -> Bool[np.ndarray, " n"]:
    """Return a mask of samples that repeat the positions before and after them, which says nothing about the noise."""
    moved = np.diff(recording.positions, axis=0).any(axis=1)
    rest = ~(np.append(False, moved) | np.append(moved, False))
    return rest if not rest.all() else np.zeros(len(rest), bool)


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
