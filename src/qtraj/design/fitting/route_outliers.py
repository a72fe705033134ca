"""Find outliers, which are samples that are much farther from the route than the other samples."""

from typing import Any

import numpy as np

from qtraj.design.fitting.route_choice import Recording
from qtraj.design.fitting.route_knots import equal_knots
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve
from qtraj.foundation.arrays import as_float, concrete, require_positive

SPACING, STEPS = 1.0, 2
"""Minimum initial knot spacing, in seconds and in time steps of the recording; the longer one applies."""

SMOOTHING = 1e-4
"""Product of the initial smoothing and the median time step of the recording [s⁶]."""

OUTLIER_RATIO = 10.0
"""A sample can be an outlier only if its distance exceeds this factor times the upper quartile of the distances.

All distances are from the route.
"""

MIN_JUMP = 0.5
"""Consecutive distant samples are outliers if the error vector changes from one sample to the next by at least this
fraction of their largest error."""

MAX_ROUNDS, REDUCTION = 12, 0.3
"""Maximum number of fits, and the factor by which the bound decreases from one fit to the next."""

END_TOLERANCE = 1e-6
"""Tolerance on the first and the last of the user's knots, relative to the duration."""

MIN_QUARTILE = 1e-8
"""[m] Lower bound on the quartile, so that rounding errors do not turn noiseless samples into outliers."""


def without_outliers(recording: Recording, knots: Any) -> tuple[Recording, float, np.ndarray | None]:
    """Set the weight of outliers to 0.

    Returns the recording with the new weights, the initial knot spacing, and the user's knots (or None). The route is
    fitted several times, and the bound on the distance decreases from fit to fit. Therefore the worst samples are
    excluded first, so that good samples are not excluded merely because bad samples distort the route.
    """
    duration = float(recording.times[-1])
    spacing, user_knots = max(SPACING, STEPS * recording.step), None
    if knots is not None:
        values = np.asarray(concrete(knots), float)
        if values.ndim == 0:
            require_positive(as_float(values), "knots", "s")
            spacing = min(float(values), duration)
            user_knots = equal_knots(duration, spacing)
        else:
            user_knots = _checked_knots(values, duration)
            spacing = float(np.median(np.diff(user_knots)))
    grid = equal_knots(duration, spacing) if user_knots is None else user_knots
    at, jerk, bound = design(grid, recording.times), jerk_system(grid), np.inf
    samples = sample_system(at, recording.positions, recording.position_weights)
    earlier = {recording.weights.tobytes()}
    for _ in range(MAX_ROUNDS):
        states = solve(samples.plus(jerk, SMOOTHING / recording.step))
        residuals = recording.position_sigmas.scaled(predict(at, states) - recording.positions)
        inliers = lengths(residuals)[recording.weights > 0]
        final_bound = outlier_bound(inliers)
        bound = max(final_bound, REDUCTION * min(bound, inliers.max()))
        weights = (~outliers(residuals, bound)).astype(float)
        change = weights - recording.weights
        changed = change != 0
        if changed.any():
            recording = recording._replace(weights=weights)
            changes = recording.position_sigmas.of(change)[changed]
            part = sample_system(at.part(changed), recording.positions[changed], changes)
            samples = samples.plus(part)
        if bound == final_bound and weights.tobytes() in earlier:
            break  # otherwise the same samples could be excluded and included alternately
        earlier.add(weights.tobytes())
    return recording, spacing, user_knots


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths (n,) of vectors (n, 3); faster than `numpy.linalg.norm`."""
    return np.sqrt(np.einsum("nk,nk->n", vectors, vectors))


def outlier_bound(distances: np.ndarray) -> float:
    """Return the distance [m] above which a sample can be an outlier, from the distances of all inliers."""
    return OUTLIER_RATIO * max(float(np.quantile(distances, 0.75)), MIN_QUARTILE)


def outliers(residuals: np.ndarray, bound: float) -> np.ndarray:
    """Return a mask (n,) of the outliers, from the differences (n, 3) [m] between route and samples.

    If standard deviations were given, the differences must already be multiplied by the square roots of the weights.
    Consecutive samples with distances above `bound` are outliers only if the difference changes abruptly from one
    sample to the next. Otherwise the knots are too far apart to follow the motion, for example a swerve between two
    knots.
    """
    distances, steps = lengths(residuals), lengths(np.diff(residuals, axis=0))
    above = np.concatenate([[False], distances > bound, [False]])
    marked = np.zeros(len(distances), bool)
    for start, end in zip(
        np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:]), strict=True
    ):
        jump = steps[max(start - 1, 0) : end].max()
        marked[start:end] = jump >= MIN_JUMP * distances[start:end].max()
    return marked


def _checked_knots(times: np.ndarray, duration: float) -> np.ndarray:
    increasing = times.ndim == 1 and len(times) > 1 and np.all(np.diff(times) > 0)
    tolerance = END_TOLERANCE * duration
    if not increasing or abs(times[0]) > tolerance or abs(times[-1] - duration) > tolerance:
        raise ValueError(
            f"knots must be a spacing [s], or times that increase from 0 to the duration {duration:.9g} s, "
            f"but {times.tolist() if times.size < 8 else f'an array of {times.size} numbers'} was given"
        )
    return np.concatenate([[0.0], times[1:-1], [duration]])
