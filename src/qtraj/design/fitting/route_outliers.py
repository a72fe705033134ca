"""Find outliers, which are samples that are much farther from the route than the other samples."""

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.design.fitting.route_choice import Recording
from qtraj.design.fitting.route_jumps import MIN_SCALE, displaced, jumps, lengths
from qtraj.design.fitting.route_knots import equal_knots
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve
from qtraj.foundation.arrays import as_float, concrete, require_positive

SPACING, STEPS = 1.0, 2
"""Minimum initial knot spacing, in seconds and in time steps of the recording; the longer one applies."""

SMOOTHING = 1e-4
"""Product of the initial smoothing and the median time step of the recording [s⁶]."""

OUTLIER_RATIO = 10.0
"""A sample can be an outlier only if its distance exceeds this factor times the upper quartile of the distances.

The quartile is that of the samples that are not outliers; all distances are from the route.
"""

MIN_JUMP, MIN_RECORDED_JUMP = 0.5, 0.05
"""Consecutive distant samples are outliers if from one sample to the next the error vector changes by at least the
first fraction of their largest error, and the recorded position jumps by at least the second one. The second one is
smaller, because other outliers nearby disturb the velocity from which a jump is measured."""

QUIET = 5.0
"""There are no outliers if no distance from a first fit exceeds this multiple of the median distance."""

CONVEX, REDESCENDING, SETTLED = 20, 10, 0.01
"""Maximum number of fits for the smallest sum of distances, maximum number of fits with redescending weights, and the
relative change of the median distance, or the change of a weight, at which either ends."""

BIWEIGHT = 6.0
"""Distance at which Tukey's biweight becomes zero, in median distances."""

MAX_ROUNDS = 12
"""Maximum number of fits after which outliers are found again."""

END_TOLERANCE = 1e-6
"""Tolerance on the first and the last of the user's knots, relative to the duration."""


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
    at, jerk = design(grid, recording.times), jerk_system(grid)

    def residuals(weights: np.ndarray) -> np.ndarray:
        samples = sample_system(at, recording.positions, recording.position_sigmas.of(weights))
        states = solve(samples.plus(jerk, SMOOTHING / recording.step))
        return recording.position_sigmas.scaled(predict(at, states) - recording.positions)

    steps = jumps(recording)
    trusted = ~displaced(steps)
    distances = lengths(residuals(np.ones(len(trusted))))
    if trusted.all() and distances.max() <= QUIET * max(float(np.median(distances)), MIN_SCALE):
        return recording, spacing, user_knots
    weights = _robust_weights(residuals, trusted)
    errors = residuals(weights)
    marked = outliers(errors, steps, outlier_bound(lengths(errors)[weights > 0]))
    for _ in range(MAX_ROUNDS):
        errors = residuals((~marked).astype(float))
        again = outliers(errors, steps, outlier_bound(lengths(errors)[~marked]))
        if np.array_equal(again, marked):
            break
        marked = again
    return recording._replace(weights=(~marked).astype(float)), spacing, user_knots


def _robust_weights(residuals: Callable[[np.ndarray], np.ndarray], trusted: np.ndarray) -> np.ndarray:
    """Return the weights (n,) of a robust fit: first of the smallest sum of distances, then redescending weights.

    Samples that are not `trusted` have no weight in the first fits.
    """
    weights, last = trusted.astype(float), np.inf
    for _ in range(CONVEX):
        distances = lengths(residuals(weights))
        scale = max(float(np.median(distances)), MIN_SCALE)
        weights = trusted * scale / np.maximum(distances, scale)
        if abs(scale - last) < SETTLED * scale:
            break
        last = scale
    for _ in range(REDESCENDING):
        distances, before = lengths(residuals(weights)), weights
        scale = max(float(np.median(distances)), MIN_SCALE)
        weights = np.maximum(1 - (distances / (BIWEIGHT * scale)) ** 2, 0.0) ** 2
        if np.abs(weights - before).max() < SETTLED:
            break
    return weights


def outlier_bound(distances: np.ndarray) -> float:
    """Return the distance [m] above which a sample can be an outlier, from the distances of the other samples."""
    return OUTLIER_RATIO * max(float(np.quantile(distances, 0.75)), MIN_SCALE)


def outliers(residuals: np.ndarray, jumps: np.ndarray, bound: float) -> np.ndarray:
    """Return a mask (n,) of the outliers, from the differences (n, 3) [m] between route and samples.

    `jumps` (n − 1, 3) are those of `route_jumps`. If standard deviations were given, the differences must already be
    multiplied by the square roots of the weights. Consecutive samples with distances above `bound` are outliers only if
    both the difference and the recorded position change abruptly from one sample to the next. Otherwise it is the route
    that does not follow the motion, for example a swerve between two knots, or a bend that continues after a gap.
    """
    distances = lengths(residuals)
    changes = np.minimum(lengths(np.diff(residuals, axis=0)) / MIN_JUMP, lengths(jumps) / MIN_RECORDED_JUMP)
    above = np.concatenate([[False], distances > bound, [False]])
    marked = np.zeros(len(distances), bool)
    for start, end in zip(
        np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:]), strict=True
    ):
        marked[start:end] = changes[max(start - 1, 0) : end].max() >= distances[start:end].max()
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
