"""Finds outliers: samples that are much farther from the route than the others."""

from typing import Any

import numpy as np

from qtraj.design.fitting.route_choice import Recording
from qtraj.design.fitting.route_knots import equal_knots
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve
from qtraj.foundation.arrays import as_float, concrete, require_positive

SPACING, STEPS = 1.0, 2
"""Minimum initial spacing of the knots: in seconds, and in time steps of the recording."""

SMOOTHING = 1e-4
"""Initial smoothing [s⁶], to be divided by the median time step [s]."""

OUTLIER_RATIO = 10.0
"""A sample is an outlier if its distance from the route exceeds the upper quartile of the distances by this factor."""

MIN_JUMP = 0.5
"""Outliers jump by at least this fraction of their largest distance from one sample to the next."""

MAX_ROUNDS, REDUCTION = 12, 0.3
"""Maximum number of fits, and the factor by which the bound decreases from one to the next."""

END_TOLERANCE = 1e-6
"""Tolerance on the first and the last of the user's knots, relative to the duration."""

MIN_QUARTILE = 1e-8
"""[m] Lower bound on the quartile, so that rounding errors of noiseless samples do not make outliers."""


def without_outliers(recording: Recording, knots: Any) -> tuple[Recording, float, np.ndarray | None]:
    """The recording with weight 0 for outliers; the initial spacing of the knots; the user's knots, or None.

    The bound on the distance decreases from fit to fit. So the worst samples are removed first, before they can pull
    the route away from good samples.
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
    samples = sample_system(len(grid), at, recording.positions, recording.weights)
    for _ in range(MAX_ROUNDS):
        states = solve(samples.plus(jerk, SMOOTHING / recording.step))
        residuals = predict(at, states) - recording.positions
        inliers = np.linalg.norm(residuals[recording.weights > 0], axis=1)
        final_bound = outlier_bound(inliers)
        bound = max(final_bound, REDUCTION * min(bound, inliers.max()))
        weights = (~outliers(residuals, bound)).astype(float)
        change = weights - recording.weights
        changed = change != 0
        if bound == final_bound and not changed.any():
            break
        if changed.any():
            recording = recording._replace(weights=weights)
            part = sample_system(len(grid), at.part(changed), recording.positions[changed], change[changed])
            samples = samples.plus(part)
    return recording, spacing, user_knots


def outlier_bound(distances: np.ndarray) -> float:
    """The distance above which a sample is an outlier [m], from the distances of all inliers."""
    return OUTLIER_RATIO * max(float(np.quantile(distances, 0.75)), MIN_QUARTILE)


def outliers(residuals: np.ndarray, bound: float) -> np.ndarray:
    """Whether each sample is an outlier (n,), from the differences between route and samples (n, 3) [m].

    Consecutive samples above the bound are outliers only if they jump away from their neighbours. Otherwise they belong
    to a motion that the route does not follow yet, such as a swerve between two knots.
    """
    distances = np.linalg.norm(residuals, axis=1)
    steps = np.linalg.norm(np.diff(residuals, axis=0), axis=1)
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
