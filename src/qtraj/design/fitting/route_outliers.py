"""Find outliers, which are samples that are much farther from the route than the other samples."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_jumps import MIN_SCALE, at_rest, displaced, jumps, lengths
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve

SMOOTHING = 1e-4
"""Product of the initial smoothing and the median time step of the recording, in units of time."""

OUTLIER_RATIO = 10.0
"""A sample can be an outlier only if its distance exceeds this factor times the upper quartile of the distances.

The quartile is that of the samples that are not outliers; all distances are from the route.
"""

MIN_JUMP, MIN_RECORDED_JUMP = 0.5, 0.25
"""Consecutive distant samples are outliers if from one sample to the next the error vector changes by at least the
first fraction of their largest error, and the recorded position jumps by at least the second one. The second one is
smaller, because other outliers nearby disturb the velocity from which a jump is measured."""

USUAL = 0.05
"""Quantile of the recorded jumps that is usual; smaller errors are no outliers, because tight bends have such jumps."""

QUIET = 5.0
"""There are no outliers if no distance from a first fit exceeds this multiple of the median distance."""

CONVEX, REDESCENDING, SETTLED = 20, 10, 0.01
"""Maximum number of fits for the smallest sum of distances, maximum number of fits with redescending weights, and the
relative change of the median distance, or the change of a weight, at which either ends."""

BIWEIGHT, LEAST_WEIGHT = 6.0, 1e-3
"""Distance at which Tukey's biweight becomes zero, in median distances, and a small weight of all samples, relative to
that for the smallest sum of distances, without which the route is free where all samples are distant."""

MAX_ROUNDS = 12
"""Maximum number of fits after which outliers are found again."""


def without_outliers(recording: Recording, grid: Float[np.ndarray, " m"]) -> Recording:
    """Return the recording with weight 0 for outliers.

    A route with the knots `grid` is fitted several times, and the bound on the distance decreases from fit to fit.
    Therefore the worst samples are excluded first, so that good samples are not excluded merely because bad samples
    distort the route.
    """
    at, jerk = design(grid, recording.times), jerk_system(grid)

    def residuals(weights: np.ndarray) -> np.ndarray:
        samples = sample_system(at, recording.positions, recording.position_sigmas.of(weights))
        states = solve(samples.plus(jerk, SMOOTHING / recording.step))
        return recording.position_sigmas.scaled(predict(at, states) - recording.positions)

    steps, telling = jumps(recording), ~at_rest(recording)
    trusted = ~displaced(steps)
    distances = lengths(residuals(np.ones(len(trusted))))
    if trusted.all() and distances.max() <= QUIET * max(float(np.median(distances[telling])), MIN_SCALE):
        return recording
    weights = _robust_weights(residuals, trusted, telling)
    errors = residuals(weights)
    marked = outliers(errors, steps, outlier_bound(lengths(errors)[telling & (weights > LEAST_WEIGHT)]))
    for _ in range(MAX_ROUNDS):
        errors = residuals((~marked).astype(float))
        again = outliers(errors, steps, outlier_bound(lengths(errors)[telling & ~marked]))
        if np.array_equal(again, marked):
            break
        marked = again
    return recording._replace(weights=(~marked).astype(float))


def _robust_weights(
    residuals: Callable[[np.ndarray], np.ndarray], trusted: np.ndarray, telling: np.ndarray
) -> np.ndarray:
    """Return the weights (n,) of a robust fit: first of the smallest sum of distances, then redescending weights.

    Samples that are not `trusted` have no weight in the first fits; the median distance is that of `telling` samples.
    """
    weights, last = trusted.astype(float), np.inf
    for _ in range(CONVEX):
        distances = lengths(residuals(weights))
        scale = max(float(np.median(distances[telling])), MIN_SCALE)
        weights = trusted * scale / np.maximum(distances, scale)
        if abs(scale - last) < SETTLED * scale:
            break
        last = scale
    for _ in range(REDESCENDING):
        distances, before = lengths(residuals(weights)), weights
        scale = max(float(np.median(distances[telling])), MIN_SCALE)
        biweights = np.maximum(1 - (distances / (BIWEIGHT * scale)) ** 2, 0.0) ** 2
        weights = np.maximum(biweights, LEAST_WEIGHT * scale / np.maximum(distances, scale))
        if np.abs(weights - before).max() < SETTLED:
            break
    return weights


def outlier_bound(distances: np.ndarray) -> float:
    """Return the distance above which a sample can be an outlier, from the distances of the other samples."""
    return OUTLIER_RATIO * max(float(np.quantile(distances, 0.75)) if len(distances) else 0.0, MIN_SCALE)


def outliers(residuals: np.ndarray, jumps: np.ndarray, bound: float) -> np.ndarray:
    """Return a mask (n,) of the outliers, from the differences (n, 3) between route and samples.

    `jumps` (n − 1, 3) are those of `route_jumps`. If standard deviations were given, the differences must already be
    multiplied by the square roots of the weights. Samples with distances above `bound` are outliers only if both the
    difference and the recorded position change abruptly from one sample to the next. Otherwise it is the route that
    does not follow the motion, for example a swerve between two knots, or a bend that continues after a gap. The worst
    of consecutive samples are excluded first, because the others may only be beside them.
    """
    sizes = lengths(jumps)
    moved = sizes[sizes > MIN_SCALE]
    bound = max(bound, float(np.quantile(moved, USUAL))) if len(moved) else bound
    marked = np.zeros(len(residuals), bool)
    for _ in range(MAX_ROUNDS):
        rest = np.flatnonzero(~marked)
        worst = rest[_abrupt(residuals[rest], np.maximum.reduceat(sizes, rest[:-1])[: len(rest) - 1], bound)]
        if not len(worst):
            break
        marked[worst] = True
    return marked


def _abrupt(residuals: np.ndarray, sizes: np.ndarray, bound: float) -> np.ndarray:
    """Return a mask (n,) of the worst samples of each run with distances above `bound` that changes abruptly.

    `sizes` (n − 1,) are the lengths of the recorded jumps.
    """
    distances = lengths(residuals)
    changes = np.minimum(lengths(np.diff(residuals, axis=0)) / MIN_JUMP, sizes / MIN_RECORDED_JUMP)
    above = np.concatenate([[False], distances > bound, [False]])
    marked = np.zeros(len(distances), bool)
    for start, end in zip(
        np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:]), strict=True
    ):
        largest = distances[start:end].max()
        if changes[max(start - 1, 0) : end].max() >= largest:
            marked[start:end] = distances[start:end] >= MIN_JUMP * largest
    return marked
