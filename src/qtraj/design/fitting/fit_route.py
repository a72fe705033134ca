"""Fits a route to a whole recorded drive or flight: banded least squares for the states at the knots.

The fit minimises the weighted sum of squared distances of the samples and of squared errors of recorded velocities,
plus `smoothing`·∫|r⃛|²dt. The weight of the velocities is the ratio of the two variances. The computation uses NumPy
arrays relative to the first sample and O(samples) time; only the comparison with the recording is compiled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting import route_choice as choice
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.fitting.route_choice import Problem, Recording
from qtraj.design.fitting.route_knots import equal_knots, find_stops, with_stops
from qtraj.design.fitting.route_outliers import SMOOTHING, SPACING, STEPS, outlier_bound, outliers, without_outliers
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve
from qtraj.foundation.arrays import as_array
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude_residual import compare_attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.residual import compare
from qtraj.path.route import Route
from qtraj.path.track import STANDSTILL, Track, to_float64

MAX_HALVINGS, MIN_GAIN = 3, 0.03
"""Maximum number of times the spacing is halved, and the minimum relative decrease of the score for another halving."""

GAP = 4.0
"""Minimum length of a gap, in spacings of the knots and in time steps of the recording."""


def fit_route(
    track: Track,
    knots: ArrayInput | None = None,
    tolerance: float | int | None = None,
    smoothing: float | int | None = None,
    *,
    throw: bool = False,
) -> FittedRoute:
    """Fit a route to a whole `track`, with stops and straight parts; time 0 of the route is the first sample.

    `knots` [s]: their spacing, or their times since the first sample, increasing from 0 to the duration. `smoothing`
    [s⁵]: the weight of ∫|r⃛|²dt, relative to the sum of squared distances [m²]. By default both are chosen by
    cross-validation: they minimise the error of the predicted velocities (of the positions, if no velocities are
    recorded) in held-out intervals of 1.5 s. With a `tolerance` [m], the fit uses the largest smoothing for which the
    RMS distance does not exceed the tolerance.

    A stop is detected if the vehicle stays within 0.1 m, below 0.5 % of its largest speed, for a second or more. There
    the velocity and acceleration of the route are exactly zero. Samples that jump away from their neighbours by more
    than ten times the upper quartile of the distances are excluded as `outliers`. Gaps are interpolated with minimum
    jerk. `covariance()` of the result is the covariance of the states at the knots. The fit does not use recorded
    attitudes; `attitude` of the result compares them with the upright frame of the route, by `compare_attitude`. For
    geographic coordinates use `read_track(..., projection=...)`. Use float64. The fit is not differentiable; the route
    is, like any other path.

    **Raises:** ValueError for invalid knots, a tolerance or smoothing that is not positive, a tolerance that is too
    small, both at once, or fewer than eight samples. RuntimeError with `throw` if the result is not finite.
    """
    _require(tolerance=tolerance, smoothing=smoothing)
    recording, spacing, user_knots = without_outliers(_recording(track), knots)
    stops = _stops(recording)
    problem, best, stretch_error = _chosen(recording, stops, spacing, user_knots, tolerance, smoothing)
    solution = _solution(recording, problem, best)
    recording, solution = _with_inliers(recording, problem, best, solution)

    origin, dtype = to_float64(track.positions)[0], track.positions.dtype
    states = solution.states
    orders = [states[:, 0] + origin, states[:, 1], states[:, 2]]
    path = Route(*(as_array(x, dtype) for x in (problem.knots, *orders)))
    inliers = recording.weights > 0
    finite = bool(np.isfinite(states).all())
    attitude = None if track.attitudes is None else compare_attitude(FrameProgram(path), track)
    fitted = FittedRoute(
        path,
        compare(path, _part(track, inliers)),
        _prediction_error(recording, problem, best),
        stretch_error,
        best,
        np.flatnonzero(~inliers),
        stops,
        _gaps(recording, problem.knots),
        solution.sigma,
        solution.matrix,
        ResultCode.successful if finite else ResultCode.not_finite,
        attitude,
    )
    return fitted.check() if throw else fitted


class _Solution(NamedTuple):
    """States at the knots (m, 3, 3), standard deviation of the positions [m], and matrix of the normal equations."""

    states: np.ndarray
    sigma: float
    matrix: np.ndarray


def _recording(track: Track) -> Recording:
    times, positions = to_float64(track.times), to_float64(track.positions)
    if len(times) < 8:
        raise ValueError(f"a route needs at least 8 samples, but the track has {len(times)}")
    velocities = None if track.velocities is None else to_float64(track.velocities)
    return Recording(times - times[0], positions - positions[0], velocities, np.ones(len(times)))


def _stops(recording: Recording) -> list[tuple[float, float]]:
    """The intervals of stops, from the recorded speeds or the speeds of a preliminary fit."""
    inliers = recording.weights > 0
    times, positions = recording.times[inliers], recording.positions[inliers]
    if np.linalg.norm(positions - positions.mean(axis=0), axis=1).max() <= STANDSTILL:
        return [(0.0, float(recording.times[-1]))]
    if recording.velocities is not None:
        speeds = np.linalg.norm(recording.velocities[inliers], axis=1)
    else:
        grid = equal_knots(float(recording.times[-1]), max(SPACING, STEPS * recording.step))
        samples = sample_system(len(grid), design(grid, times), positions, np.ones(len(times)))
        states = solve(samples.plus(jerk_system(grid), SMOOTHING / recording.step))
        speeds = np.linalg.norm(predict(design(grid, times, 1), states), axis=1)
    return find_stops(times, positions, speeds, recording.step)


def _chosen(
    recording: Recording,
    stops: list[tuple[float, float]],
    spacing: float,
    user_knots: np.ndarray | None,
    tolerance: float | None,
    smoothing: float | None,
) -> tuple[Problem, float, float]:
    """The problem on the chosen knots, the smoothing, and the error in held-out intervals [m]."""
    duration, start = float(recording.times[-1]), SMOOTHING / recording.step
    folds = choice.folds(recording.times, recording.step)

    def on(knots: np.ndarray) -> Problem:
        return choice.problem(recording, *with_stops(knots, stops), folds)

    problem = on(equal_knots(duration, spacing) if user_knots is None else user_knots)
    if smoothing is not None:
        best = float(smoothing)
    elif tolerance is not None:
        best = choice.largest_smoothing(recording, problem, start, float(tolerance))
    elif not folds:
        best = start
    else:
        best, min_score = choice.best_smoothing(recording, problem, start)
        for _ in range(MAX_HALVINGS if user_knots is None else 0):
            spacing /= 2
            finer = on(equal_knots(duration, spacing))
            if choice.score(recording, finer, best) > min_score * (1 - MIN_GAIN):
                break
            problem = finer
            best, min_score = choice.best_smoothing(recording, problem, best)
    of_positions = recording._replace(velocities=None)
    stretch_error = float(np.sqrt(choice.score(of_positions, problem, best))) if folds else np.nan
    return problem, best, stretch_error


def _solution(recording: Recording, problem: Problem, smoothing: float) -> _Solution:
    """The fit to positions and recorded velocities.

    The weight of the velocities is the ratio of the variances of the two residuals in a fit to the positions only.
    """
    inliers, system = recording.weights > 0, problem.system(smoothing)
    states = solve(system)
    offsets = (predict(problem.positions, states) - recording.positions)[inliers]
    sigma = float(np.sqrt(np.mean(offsets**2)))
    if recording.velocities is not None and problem.velocities is not None:
        velocity_errors = (predict(problem.velocities, states) - recording.velocities)[inliers]
        ratio = sigma**2 / max(float(np.mean(velocity_errors**2)), 1e-30)
        weights = ratio * recording.weights
        system = system.plus(sample_system(len(problem.knots), problem.velocities, recording.velocities, weights))
        states = solve(system)
    return _Solution(_with_exact_stops(states, problem), max(sigma, 1e-12), system.matrix)


def _with_exact_stops(states: np.ndarray, problem: Problem) -> np.ndarray:
    """The states with exactly zero derivatives, and exactly one position, at each stop."""
    at_stop = problem.stops.matrix[-1, 1::3] > 0
    states = states.copy()
    states[at_stop, 1:] = 0.0
    first = np.flatnonzero(problem.stops.matrix[-4, 3::3] < 0)
    middle = 0.5 * (states[first, 0] + states[first + 1, 0])
    states[first, 0] = middle
    states[first + 1, 0] = middle
    return states


def _with_inliers(
    recording: Recording, problem: Problem, smoothing: float, solution: _Solution
) -> tuple[Recording, _Solution]:
    """The fit with all samples that are not outliers at the final smoothing; they were found with the initial one."""
    if (recording.weights > 0).all():
        return recording, solution
    residuals = predict(problem.positions, solution.states) - recording.positions
    bound = outlier_bound(np.linalg.norm(residuals[recording.weights > 0], axis=1))
    weights = (~outliers(residuals, bound)).astype(float)
    if np.array_equal(weights, recording.weights):
        return recording, solution
    recording = recording._replace(weights=weights)
    samples = sample_system(len(problem.knots), problem.positions, recording.positions, weights)
    return recording, _solution(recording, problem._replace(samples=samples), smoothing)


def _prediction_error(recording: Recording, problem: Problem, smoothing: float) -> float:
    """The RMS distance of every second sample from a route that is fitted to the others [m]."""
    fitted = np.arange(len(recording.times)) % 2 == 0
    positions, weights = recording.positions, recording.weights
    samples = sample_system(len(problem.knots), problem.positions.part(fitted), positions[fitted], weights[fitted])
    # Half of the samples have half of the weight, so the smoothing is halved, too.
    states = solve(samples.plus(problem.jerk, 0.5 * smoothing).plus(problem.stops))
    squares = np.sum((predict(problem.positions.part(~fitted), states) - positions[~fitted]) ** 2, axis=1)
    return float(np.sqrt(np.mean(squares[weights[~fitted] > 0])))


def _gaps(recording: Recording, knots: np.ndarray) -> Float[np.ndarray, "j 2"]:
    times = recording.times[recording.weights > 0]
    longest = GAP * max(float(np.median(np.diff(knots))), recording.step)
    before = np.flatnonzero(np.diff(times) > longest)
    return np.stack([times[before], times[before + 1]], axis=1)


def _part(track: Track, inliers: np.ndarray) -> Track:
    """The inliers, and always the first sample, because the comparison starts at time 0 of the route."""
    if inliers.all():
        return track
    kept = inliers.copy()
    velocities = None if track.velocities is None else to_float64(track.velocities)[kept]
    if not kept[0]:
        kept[0], velocities = True, None
    return Track(to_float64(track.times)[kept], to_float64(track.positions)[kept], velocities)


def _require(**numbers: float | int | None) -> None:
    for name, value in numbers.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite, but {value!r} was given")
    if sum(numbers.get(name) is not None for name in ("tolerance", "smoothing")) == 2:
        raise ValueError("tolerance and smoothing were both given, but a tolerance determines the smoothing: pass one")
