"""Fit a route to a whole recorded drive or flight by banded linear least squares for the states at the knots.

The fit minimises a sum of three terms: the squared distances of the samples, the weighted squared errors of recorded
velocities, and `smoothing`·∫|r⃛|²dt. The weight of the velocities is the variance of the position errors divided by the
variance of the velocity errors. Standard deviations of individual samples are converted to weights with mean 1. The
computation uses NumPy and positions relative to the first sample. Its run time is proportional to the number of
samples. Only the comparison with the recording is compiled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting import route_choice as choice
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.fitting.noise_free import without_smoothing
from qtraj.design.fitting.route_choice import Problem, Recording
from qtraj.design.fitting.route_jumps import jumps
from qtraj.design.fitting.route_knots import equal_knots, find_stops, with_stops
from qtraj.design.fitting.route_outliers import SMOOTHING, SPACING, STEPS, outlier_bound, outliers, without_outliers
from qtraj.design.fitting.route_sigmas import read_sigmas
from qtraj.design.fitting.route_system import design, jerk_system, predict, sample_system, solve
from qtraj.design.fitting.waypoints import FEW, keep_all, knots_and_smoothing
from qtraj.foundation.arrays import as_array
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude_residual import compare_attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.rate_residual import compare_upright
from qtraj.path.residual import compare
from qtraj.path.route import Route
from qtraj.path.track import STANDSTILL, Track, require_track, to_float64

MAX_HALVINGS, MIN_GAIN = 3, 0.03
"""Maximum number of halvings of the knot spacing, and the minimum relative decrease of the score by a halving."""

GAP = 4.0
"""Minimum length of a gap, in median knot spacings or in time steps of the recording, whichever is longer."""


def fit_route(
    track: Track,
    knots: ArrayInput | None = None,
    tolerance: float | int | None = None,
    smoothing: float | int | None = None,
    position_sigma: ArrayInput | None = None,
    velocity_sigma: ArrayInput | None = None,
    *,
    throw: bool = False,
) -> FittedRoute:
    """Fit a route to a whole `track`, including stops and straight segments.

    Time 0 of the route is the time of the first sample. `knots` [s] is the knot spacing, or an array of knot times that
    increase from 0 to the duration. `smoothing` [s⁵] is the weight of ∫|r⃛|²dt relative to the sum of squared distances
    [m²]. By default both are chosen by cross-validation. They minimise the error of the predicted velocities in
    held-out intervals of at least 1.5 s, or of the predicted positions if no velocities are recorded. With a
    `tolerance` [m], the fit uses the largest smoothing for which the RMS distance does not exceed the tolerance.

    Fewer than eight samples are waypoints: the route passes through them with minimum jerk.

    A stop is an interval of at least one second in which the vehicle stays within 0.1 m of its mean position and is not
    faster than 0.5 % of its largest speed. At a stop the velocity and acceleration of the route are exactly zero.
    Samples are excluded as `outliers` if their distance from the route exceeds ten times the upper quartile of the
    distances and changes abruptly from one sample to the next. Gaps in the recording are bridged with minimum jerk. The
    method `covariance` of the result returns the covariances of the states at the knots. The fit does not use recorded
    attitudes and angular rates. The fields `attitude` and `rates` of the result compare them with the upright frame of
    the route (see `compare_attitude` and `compare_rates`). For geographic coordinates use `read_track(...,
    projection=...)`. A recording without noise, such as samples of a formula, is fitted without smoothing. Use float64.
    The fit is not differentiable; the route is differentiable like any other path.

    `position_sigma` [m] and `velocity_sigma` [m/s] are the standard deviations of the recorded positions and
    velocities: a number, an array (n,) with a value for each sample, or an array (n, 3) with a value for each
    component. Each squared error is divided by its variance. These weights also apply to the errors in held-out
    intervals and to the detection of outliers. If one of the two sigmas is not given, the corresponding errors have
    equal weights, and their variance is estimated from the residuals of a fit to the positions.

    **Raises:** ValueError for invalid knots, a tolerance, smoothing or standard deviation that is not positive, a
    tolerance that is too small, both a tolerance and a smoothing, one of them with fewer than eight samples, standard
    deviations of the wrong shape, or a `velocity_sigma` without recorded velocities. RuntimeError with `throw` if the
    result is not finite.
    """
    _require(tolerance=tolerance, smoothing=smoothing)
    require_track(track)
    recording, few = _recording(track, position_sigma, velocity_sigma), len(track.times) < FEW
    knots, smoothing = knots_and_smoothing(track, knots, tolerance, smoothing)
    free = knots is None and tolerance is None and smoothing is None
    exact = without_smoothing(recording) if free and not _stops(recording) else None
    if exact is None:
        recording, spacing, user_knots = (keep_all if few else without_outliers)(recording, knots)
    else:
        (user_knots, smoothing), spacing = exact, float(exact[0][1])
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
        float("nan") if few else _prediction_error(recording, problem, best),
        stretch_error,
        best,
        np.flatnonzero(~inliers),
        stops,
        _gaps(recording, problem.knots),
        solution.sigma,
        solution.matrix,
        ResultCode.successful if finite else ResultCode.not_finite,
        attitude,
        compare_upright(path, track),
    )
    return fitted.check() if throw else fitted


class _Solution(NamedTuple):
    """The solution of a fit.

    The axes of `states` (m, 3, 3) are the knot, the order of the derivative (position, velocity, acceleration), and the
    component. `sigma` [m] is the standard deviation of the position errors per axis. `matrix` contains the diagonals of
    the matrix of the normal equations.
    """

    states: np.ndarray
    sigma: float
    matrix: np.ndarray


def _recording(track: Track, position_sigma: ArrayInput | None, velocity_sigma: ArrayInput | None) -> Recording:
    times, positions = to_float64(track.times), to_float64(track.positions)
    velocities = None if track.velocities is None else to_float64(track.velocities)
    if velocities is None and velocity_sigma is not None:
        raise ValueError("velocity_sigma was given, but the track has no velocities: omit velocity_sigma")
    sigmas = [
        read_sigmas(sigma, name, len(times))
        for sigma, name in ((position_sigma, "position_sigma"), (velocity_sigma, "velocity_sigma"))
    ]
    return Recording(times - times[0], positions - positions[0], velocities, np.ones(len(times)), *sigmas)


def _stops(recording: Recording) -> list[tuple[float, float]]:
    """Return the intervals of stops, from the recorded speeds or from the speeds of a preliminary fit."""
    inliers = recording.weights > 0
    times, positions = recording.times[inliers], recording.positions[inliers]
    if np.linalg.norm(positions - positions.mean(axis=0), axis=1).max() <= STANDSTILL:
        return [(0.0, float(recording.times[-1]))]
    if recording.velocities is not None:
        speeds = np.linalg.norm(recording.velocities[inliers], axis=1)
    else:
        grid = equal_knots(float(recording.times[-1]), max(SPACING, STEPS * recording.step))
        weights = recording.position_weights[inliers]
        samples = sample_system(design(grid, times), positions, weights)
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
    """Return the problem on the chosen knots, the smoothing, and the RMS position error in held-out intervals [m].

    The error is NaN if the recording is too short for held-out intervals.
    """
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
        best, min_score = choice.best_smoothing(problem, start)
        for _ in range(MAX_HALVINGS if user_knots is None else 0):
            spacing /= 2
            finer = on(equal_knots(duration, spacing))
            if choice.score(finer, best) > min_score * (1 - MIN_GAIN):
                break
            problem = finer
            best, min_score = choice.best_smoothing(problem, best)
    stretch_error = float(np.sqrt(choice.position_score(recording, problem, best, folds))) if folds else np.nan
    return problem, best, stretch_error


def _solution(recording: Recording, problem: Problem, smoothing: float) -> _Solution:
    """Fit the states to the positions and the recorded velocities.

    The weight of the velocities is the variance of the position errors divided by the variance of the velocity errors.
    Variances that were not given are estimated from the residuals of a fit to the positions only.
    """
    inliers, system = recording.weights > 0, problem.system(smoothing)
    states = solve(system)
    offsets = (predict(problem.positions, states) - recording.positions)[inliers]
    sigma = recording.position_sigmas.unit or float(np.sqrt(np.mean(offsets**2)))
    if recording.velocities is not None:
        velocities = design(problem.knots, recording.times, 1)
        velocity_errors = (predict(velocities, states) - recording.velocities)[inliers]
        velocity_sigma = recording.velocity_sigmas.unit or float(np.sqrt(np.mean(velocity_errors**2)))
        weights = recording.velocity_sigmas.of(sigma**2 / max(velocity_sigma**2, 1e-30) * recording.weights)
        system = system.plus(sample_system(velocities, recording.velocities, weights))
        states = solve(system)
    return _Solution(_with_exact_stops(states, problem), max(sigma, 1e-12), system.matrix)


def _with_exact_stops(states: np.ndarray, problem: Problem) -> np.ndarray:
    """Return the states with exactly zero derivatives, and with exactly equal positions, at both ends of each stop."""
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
    """Find the outliers again with the final smoothing, and repeat the fit if the set of outliers has changed.

    The previous outliers were found with the initial smoothing.
    """
    if (recording.weights > 0).all():
        return recording, solution
    residuals = recording.position_sigmas.scaled(predict(problem.positions, solution.states) - recording.positions)
    bound = outlier_bound(np.linalg.norm(residuals[recording.weights > 0], axis=1))
    weights = (~outliers(residuals, jumps(recording), bound)).astype(float)
    if np.array_equal(weights, recording.weights):
        return recording, solution
    recording = recording._replace(weights=weights)
    samples = sample_system(problem.positions, recording.positions, recording.position_weights)
    return recording, _solution(recording, problem._replace(samples=samples), smoothing)


def _prediction_error(recording: Recording, problem: Problem, smoothing: float) -> float:
    """Return the RMS distance [m] of every second sample from a route that is fitted to the other samples."""
    fitted = np.arange(len(recording.times)) % 2 == 0
    positions, weights = recording.positions, recording.position_weights[fitted]
    samples = sample_system(problem.positions.part(fitted), positions[fitted], weights)
    # Half of the samples have half of the total weight, so the weight of the jerk is halved, too.
    states = solve(samples.plus(problem.jerk, 0.5 * smoothing).plus(problem.stops))
    errors = predict(problem.positions.part(~fitted), states) - positions[~fitted]
    squares = recording.position_sigmas.part(~fitted).squares(errors)
    return float(np.sqrt(np.mean(squares[recording.weights[~fitted] > 0])))


def _gaps(recording: Recording, knots: np.ndarray) -> Float[np.ndarray, "j 2"]:
    times = recording.times[recording.weights > 0]
    longest = GAP * max(float(np.median(np.diff(knots))), recording.step)
    before = np.flatnonzero(np.diff(times) > longest)
    return np.stack([times[before], times[before + 1]], axis=1)


def _part(track: Track, inliers: np.ndarray) -> Track:
    """Return the inliers of `track`.

    The first sample is always included, because the comparison with the route starts at time 0 of the route. If the
    first sample is an outlier, the recorded velocities are omitted.
    """
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
        raise ValueError(
            "tolerance and smoothing were both given, but the tolerance determines the smoothing: pass one of the two"
        )
