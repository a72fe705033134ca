"""A whole recorded drive or flight as a route: banded least squares over the states at the joints.

Minimised is the sum of squared distances of the samples, each with a weight, and of squared errors of recorded
velocities in the proportion of the two variances, plus `smoothing`·∫|r⃛|²dt. Everything works on NumPy arrays about
the first sample, in O(samples); nothing is compiled but the comparison with the recording.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting import route_choice as choice
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.fitting.route_choice import Recording, Setting
from qtraj.design.fitting.route_knots import even, standing, with_stops
from qtraj.design.fitting.route_outliers import SMOOTHING, SPACING, STEPS, bound_of, without_outliers
from qtraj.design.fitting.route_system import Rows, System, of_jerk, of_samples, predicted, rows, solved
from qtraj.foundation.arrays import as_array
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude_residual import compare_attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.residual import compare
from qtraj.path.route import Route
from qtraj.path.track import STANDSTILL, Track, to_float64

FINER, GAIN = 3, 0.03
"""The spacing is halved at most so often, as long as that lowers the score by this part."""

GAP = 4.0
"""A gap is longer than so many spacings of the knots, and than so many steps of time."""


def fit_route(
    track: Track,
    knots: ArrayInput | None = None,
    tolerance: float | int | None = None,
    smoothing: float | int | None = None,
    *,
    throw: bool = False,
) -> FittedRoute:
    """Fit a route to a whole `track`, with stops and straight parts; path time 0 is its first sample.

    `knots` [s since the first sample]: a number, their spacing, or the times of the joints, increasing from 0 to the
    duration. `smoothing` [s⁵] is the weight of ∫|r⃛|²dt, relative to the sum of squared distances [m²]. By default both
    are chosen by cross-validation: how well the route predicts intervals of 1.5 s that are left out, in velocity if it
    is recorded, otherwise in position. A `tolerance` [m] selects the largest smoothing with at most that root mean
    square of the distances.

    A stop is detected if the speed is below 0.5 % of the largest one, within 0.1 m, for a second or more. There the
    velocity and acceleration of the route are exactly zero. Samples whose distance exceeds ten times the upper quartile
    are left out as `outliers`. Gaps are bridged with minimum jerk. `covariance()` of the result is that of the joint
    states. Recorded attitudes are not used in the fit; `attitude` of the result compares them with the route's upright
    frame, by `compare_attitude`. For geographical coordinates use `read_track(..., projection=...)`. Use float64. The
    fit is not differentiable, but the route is, like any other path.

    **Raises:** ValueError for invalid knots, a tolerance or smoothing that is not positive or cannot be satisfied, both
    at once, or fewer than eight samples. RuntimeError with `throw` if the result is not finite.
    """
    _require(tolerance=tolerance, smoothing=smoothing)
    recording = _recording(track)
    recording, spacing, given = without_outliers(recording, knots)
    stops = _stops(recording)
    folds = choice.stretches(recording.times, recording.step)
    of, chosen, stretch = _chosen(recording, stops, folds, spacing, given, tolerance, smoothing)
    states, sigma, matrix = _states(recording, of, chosen)
    recording, states, sigma, matrix = _readmitted(recording, of, chosen, states, sigma, matrix)
    prediction = _prediction(recording, of, chosen)

    origin, dtype = to_float64(track.positions)[0], track.positions.dtype
    orders = [states[:, 0] + origin, states[:, 1], states[:, 2]]
    path = Route(*(as_array(x, dtype) for x in (of.knots, *orders)))
    counted = recording.weights > 0
    inner = _part(track, counted)
    finite = bool(np.isfinite(states).all())
    attitude = None if track.attitudes is None else compare_attitude(FrameProgram(path), track)
    fitted = FittedRoute(
        path,
        compare(path, inner),
        prediction,
        stretch,
        chosen,
        np.flatnonzero(~counted),
        stops,
        _gaps(recording, of.knots),
        sigma,
        matrix,
        ResultCode.successful if finite else ResultCode.not_finite,
        attitude,
    )
    return fitted.check() if throw else fitted


def _recording(track: Track) -> Recording:
    times, positions = to_float64(track.times), to_float64(track.positions)
    if len(times) < 8:
        raise ValueError(f"a route needs at least 8 samples, but the track has {len(times)}")
    velocities = None if track.velocities is None else to_float64(track.velocities)
    return Recording(times - times[0], positions - positions[0], velocities, np.ones(len(times)))


def _stops(recording: Recording) -> list[tuple[float, float]]:
    counted = recording.weights > 0
    times, positions = recording.times[counted], recording.positions[counted]
    if np.linalg.norm(positions - positions.mean(axis=0), axis=1).max() <= STANDSTILL:
        return [(0.0, float(recording.times[-1]))]
    if recording.velocities is not None:
        speeds = np.linalg.norm(recording.velocities[counted], axis=1)
    else:
        grid = even(float(recording.times[-1]), max(SPACING, STEPS * recording.step))
        at = rows(grid, times)
        system = of_samples(len(grid), at, positions, np.ones(len(times)))
        states = solved(system.plus(of_jerk(grid), SMOOTHING / recording.step))
        speeds = np.linalg.norm(predicted(rows(grid, times, 1), states), axis=1)
    return standing(times, positions, speeds, recording.step)


def _chosen(
    recording: Recording,
    stops: list[tuple[float, float]],
    folds: list[np.ndarray],
    spacing: float,
    given: np.ndarray | None,
    tolerance: float | None,
    smoothing: float | None,
) -> tuple[Setting, float, float]:
    """Knots with their systems, the smoothing, and the error in stretches that were left out [m]."""
    duration, start = float(recording.times[-1]), SMOOTHING / recording.step

    def on(knots: np.ndarray) -> Setting:
        return choice.setting(recording, *with_stops(knots, stops), folds)

    of = on(even(duration, spacing) if given is None else given)
    if smoothing is not None:
        best = float(smoothing)
    elif tolerance is not None:
        best = choice.within(recording, of, start, float(tolerance))
    elif not folds:
        best = start
    else:
        best, least = choice.best_smoothing(recording, of, start)
        for _ in range(FINER if given is None else 0):
            spacing /= 2
            finer = on(even(duration, spacing))
            value = choice.score(recording, finer, best)
            if value > least * (1 - GAIN):
                break
            of = finer
            best, least = choice.best_smoothing(recording, of, best)
    positions = recording._replace(velocities=None)
    stretch = float(np.sqrt(choice.score(positions, of, best))) if folds else np.nan
    return of, best, stretch


def _states(recording: Recording, of: Setting, smoothing: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Joint states, the standard deviation of positions, and the matrix; with velocities if they are recorded.

    Velocities weigh as the ratio of the variances that both leave when only positions are fitted.
    """
    counted, system = recording.weights > 0, of.whole.plus(of.jerk, smoothing).plus(of.held)
    states = solved(system)
    away = (predicted(of.at, states) - recording.positions)[counted]
    sigma = float(np.sqrt(np.mean(away**2)))
    if recording.velocities is not None and of.slopes is not None:
        slips = (predicted(of.slopes, states) - recording.velocities)[counted]
        ratio = sigma**2 / max(float(np.mean(slips**2)), 1e-30)
        weights = ratio * recording.weights
        system = system.plus(of_samples(len(of.knots), of.slopes, recording.velocities, weights))
        states = solved(system)
    return _rested(states, of), max(sigma, 1e-12), system.matrix


def _rested(states: np.ndarray, of: Setting) -> np.ndarray:
    """The states with exact rest where the vehicle stands."""
    held = of.held.matrix[-1, 1::3] > 0
    states = states.copy()
    states[held, 1:] = 0.0
    together = np.flatnonzero(of.held.matrix[-4, 3::3] < 0)
    middle = 0.5 * (states[together, 0] + states[together + 1, 0])
    states[together, 0] = middle
    states[together + 1, 0] = middle
    return states


def _readmitted(
    recording: Recording, of: Setting, smoothing: float, states: np.ndarray, sigma: float, matrix: np.ndarray
) -> tuple[Recording, np.ndarray, float, np.ndarray]:
    """The fit again with those of the outliers that are none, now that the smoothing is known."""
    if (recording.weights > 0).all():
        return recording, states, sigma, matrix
    away = np.linalg.norm(predicted(of.at, states) - recording.positions, axis=1)
    weights = (away <= bound_of(away[recording.weights > 0])).astype(float)
    if np.array_equal(weights, recording.weights):
        return recording, states, sigma, matrix
    recording = recording._replace(weights=weights)
    system = of_samples(len(of.knots), of.at, recording.positions, weights)
    return recording, *_states(recording, of._replace(whole=system), smoothing)


def _prediction(recording: Recording, of: Setting, smoothing: float) -> float:
    """The root mean square of the distance at every other sample from a route through the others [m]."""
    even_ones = np.arange(len(recording.times)) % 2 == 0
    part = Rows(of.at.segment[even_ones], of.at.factors[even_ones])
    other = Rows(of.at.segment[~even_ones], of.at.factors[~even_ones])
    weights = recording.weights[even_ones]
    system: System = of_samples(len(of.knots), part, recording.positions[even_ones], weights)
    # Half of the samples: the smoothing weighs as much against them if it is halved, too.
    states = solved(system.plus(of.jerk, 0.5 * smoothing).plus(of.held))
    squares = np.sum((predicted(other, states) - recording.positions[~even_ones]) ** 2, axis=1)
    counted = recording.weights[~even_ones] > 0
    return float(np.sqrt(np.mean(squares[counted])))


def _gaps(recording: Recording, knots: np.ndarray) -> Float[np.ndarray, "j 2"]:
    times = recording.times[recording.weights > 0]
    longest = GAP * max(float(np.median(np.diff(knots))), recording.step)
    late = np.flatnonzero(np.diff(times) > longest)
    return np.stack([times[late], times[late + 1]], axis=1)


def _part(track: Track, counted: np.ndarray) -> Track:
    """The samples that count, with the first and the last in any case."""
    kept = counted.copy()
    if kept.all():
        return track
    velocities = None if track.velocities is None else to_float64(track.velocities)[kept]
    times = to_float64(track.times)
    if not kept[0]:  # the comparison begins with the first sample, which is path time 0
        kept[0], velocities = True, None
    return Track(times[kept], to_float64(track.positions)[kept], velocities)


def _require(**numbers: float | int | None) -> None:
    for name, value in numbers.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite, but {value!r} was given")
    if sum(numbers.get(name) is not None for name in ("tolerance", "smoothing")) == 2:
        raise ValueError("tolerance and smoothing exclude each other: the tolerance chooses the smoothing")
