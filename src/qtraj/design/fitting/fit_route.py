"""Fit a route to a whole recorded drive or flight by banded linear least squares for the states at the knots.

The fit minimises a sum of three terms: the squared distances of the samples, the weighted squared errors of recorded
velocities, and `smoothing`·∫|r⃛|²dt. The weight of the velocities is the variance of the position errors divided by the
variance of the velocity errors. Standard deviations of individual samples are converted to weights with mean 1. The
computation uses NumPy and positions relative to the first sample. Its run time is proportional to the number of
samples. Only the comparison with the recording is compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.curves_at_stops import Curves, segments, with_curves
from qtraj.design.fitting.fit_in_time import Choice, fit_in_time
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.fitting.noise_free import without_smoothing
from qtraj.design.fitting.recording import Recording, read_recording
from qtraj.design.fitting.route_choice import Problem
from qtraj.design.fitting.route_knots import Grid, read_knots
from qtraj.design.fitting.route_outliers import without_outliers
from qtraj.design.fitting.route_sigmas import read_sigmas
from qtraj.design.fitting.route_stops import Standing, find_stops
from qtraj.design.fitting.route_system import in_seconds, predict, sample_system, solve
from qtraj.design.fitting.route_window import Cut, Widened, clipped, cut, widened
from qtraj.design.fitting.units import Units
from qtraj.design.fitting.waypoints import FEW, knots_and_smoothing
from qtraj.foundation.arrays import like
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude_residual import compare_attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.rate_residual import compare_upright
from qtraj.path.residual import Residual, compare
from qtraj.path.route import Route, from_segments
from qtraj.path.track import MIN_SAMPLES, Track, require_track, to_float64

GAP = 4.0
"""Minimum length of a gap, in median knot spacings or in time steps of the recording, whichever is longer."""


@of_one_device
def fit_route(
    track: Track,
    knots: ArrayInput | None = None,
    tolerance: float | int | None = None,
    smoothing: float | int | None = None,
    position_sigma: ArrayInput | None = None,
    velocity_sigma: ArrayInput | None = None,
    *,
    stop_speed: float | int | None = None,
    stop_distance: float | int | None = None,
    window: Sequence[float | int] | None = None,
    throw: bool = False,
) -> FittedRoute:
    """Fit a route to a whole `track`, including stops and straight segments.

    Time 0 of the route is the time of the first sample. `knots` [s] is the knot spacing, or an array of knot times that
    increase from 0 to the duration. `smoothing` [s⁵] is the weight of ∫|r⃛|²dt relative to the sum of squared distances
    [m²]. By default both are chosen by cross-validation. They minimise the error of the predicted velocities in
    held-out intervals, or of the predicted positions if no velocities are recorded. With a `tolerance` [m], the fit
    uses the largest smoothing for which the RMS distance does not exceed the tolerance. A recording without noise, such
    as samples of a formula, is fitted without smoothing. Fewer than eight samples are waypoints: the route passes
    through them with minimum jerk.

    Apart from `stop_distance`, the fit scales with the recording: its unit of time is how long the vehicle typically
    drives almost straight, about one second for a car in a town. Knots are at most one unit apart, held-out intervals
    last at least 1.5 units, and a stop lasts at least one unit and four time steps of the recording. A stop is an
    interval in which the vehicle stays within `stop_distance` [m] of its mean position and is not faster than
    `stop_speed` [m/s]. By default they are 0.1 m and 0.5 % of the largest speed, but at least six standard deviations
    of the positions and four of the velocity of a fit by cross-validation, so that jitter at standstill is one stop. If
    the former exceed 0.4 m, a stop is an interval in which no motion of the positions, or of recorded velocities, is
    significant, and that is long enough to notice 1.5 % of the largest speed: 15 s at 10 Hz with 1 m of noise for a
    vehicle that drives 10 m/s elsewhere. At a stop the velocity and acceleration of the route are exactly zero.

    Next to a stop, and where the vehicle creeps, halts for a moment, or starts or ends slowly, noise is not a curve
    that was driven. There the route consists of regular curves R(w) with a progress w(t) (see `Route.progress`), from
    about a third of the distance that the vehicle drives almost straight before the stop, or more in noise, to as much
    after it; all samples are fitted again in the parameter w, and the progress keeps the vehicle at rest. So the
    curvature is that of the street up to the stop. Where the vehicle reverses, the route continues with the opposite
    tangent and the same curvature vector: the vehicle keeps its heading and its steering angle. Within the last
    decimetres, noise determines the curvature there. Recordings without noise are fitted in the time only, and so are
    stops at which it is unclear whether the vehicle reverses, as in a hairpin or after a turn by more than 90°, and
    points of reversal close to an end of the recording.

    Samples are excluded as `outliers` if their distance from the route exceeds ten times the upper quartile of the
    distances and changes abruptly from one sample to the next. Gaps in the recording are bridged with minimum jerk. The
    method `covariance` of the result returns the covariances of the states at the knots, of the fit in the time. The
    fit does not use recorded attitudes and angular rates. The fields `attitude` and `rates` of the result compare them
    with the upright frame of the route (see `compare_attitude` and `compare_rates`). For geographic coordinates use
    `read_track(..., projection=...)`. Use float64. The fit is not differentiable; the route is differentiable like any
    other path.

    `window` (t0, t1) [s], on the clock of the recording: the route of the samples in this interval. They are fitted
    together with samples beyond its ends, ten units on each side, so that the ends of the route are as accurate as its
    inside; all fields of the result refer to the window, except the errors at held-out samples.

    `position_sigma` [m] and `velocity_sigma` [m/s] are the standard deviations of the recorded positions and
    velocities: a number, an array (n,) with a value for each sample, or an array (n, 3) with a value for each
    component. Each squared error is divided by its variance. These weights also apply to the errors in held-out
    intervals and to the detection of outliers. If one of the two sigmas is not given, the corresponding errors have
    equal weights, and their variance is estimated from the residuals of a fit to the positions.

    **Raises:** ValueError for an invalid window, invalid knots, a tolerance, smoothing, stop speed, stop distance or
    standard deviation that is not positive, a tolerance that is too small, both a tolerance and a smoothing, one of
    them with fewer than eight samples, standard deviations of the wrong shape, or a `velocity_sigma` without recorded
    velocities. RuntimeError with `throw` if the result is not finite.
    """
    _require(tolerance=tolerance, smoothing=smoothing, stop_speed=stop_speed, stop_distance=stop_distance)
    require_track(track)
    if window is not None and knots is not None and np.ndim(knots):
        raise ValueError("with a window, knots must be a spacing [s], because other knots are used beyond its ends")
    wide = widened(track, window)
    given_sigmas = {"position_sigma": position_sigma, "velocity_sigma": velocity_sigma}
    sigmas = (_chosen_sigma(sigma, name, wide.chosen) for name, sigma in given_sigmas.items())
    track, few = wide.track, len(wide.track.times) < FEW
    recording = read_recording(track, *sigmas)
    unit = recording.units
    knots, smoothing = knots_and_smoothing(track, knots, tolerance, smoothing)
    given = Choice(
        read_knots(knots, recording.times, recording.step, unit.time),
        None if tolerance is None else float(tolerance) / unit.length,
        None if smoothing is None else float(smoothing) / unit.time**5,
        () if window is None else (wide.start / unit.time, wide.end / unit.time),
    )
    standing = Standing(
        None if stop_speed is None else float(stop_speed) * unit.time / unit.length,
        None if stop_distance is None else float(stop_distance) / unit.length,
    )
    free = knots is None and tolerance is None and smoothing is None
    exact = without_smoothing(recording) if free and not find_stops(recording, standing) else None
    if exact is not None:
        given = Choice(Grid(exact[0], float(exact[0][1]), True), None, exact[1], given.ends)
    elif not few:
        recording = without_outliers(recording, given.grid.knots)
    own = (
        given if free else Choice(read_knots(None, recording.times, recording.step, unit.time), None, None, given.ends)
    )
    in_time = fit_in_time(recording, standing, given, None if few or exact is not None else own)
    recording, problem, best, stretch_error, found, motion = in_time

    ends = wide.start / unit.time, wide.end / unit.time
    part = cut(problem.knots, found.states, found.matrix, best * problem.jerk.matrix, *ends)
    origin = to_float64(track.positions)[0]
    curves = with_curves(recording, problem, motion, best) if exact is None else None
    if curves is None:
        path = _route(wide.inner, origin, part, unit)
    else:
        path = _curved(wide, origin, curves, unit)
        recording, problem = curves.recording, curves.problem
    track = wide.inner
    inliers = (recording.weights > 0)[wide.inside]
    stops, gaps = (unit.time * np.reshape(x, (-1, 2)) for x in (motion.stops, _gaps(recording, problem.knots)))
    attitude = None if track.attitudes is None else compare_attitude(FrameProgram(path), track)
    fitted = FittedRoute(
        path,
        _residual(path, track, inliers),
        float("nan") if few else _prediction_error(recording, problem, best) * unit.length,
        stretch_error * unit.length,
        best * unit.time**5,
        np.flatnonzero(~inliers),
        clipped(stops, wide.start, wide.end),
        clipped(gaps, wide.start, wide.end),
        float("nan") if few and position_sigma is None else found.sigma * unit.length,
        in_seconds(part.matrix, unit.time),
        ResultCode.successful if np.isfinite(found.states).all() else ResultCode.not_finite,
        attitude,
        compare_upright(path, track),
        like(part.knots * unit.time, path.duration),
        in_seconds(part.penalty, unit.time),
        part.errors * (unit.length / unit.time ** np.arange(3.0))[:, None],
    )
    return fitted.check() if throw else fitted


def _chosen_sigma(sigma: Any, name: str, chosen: np.ndarray) -> Any:
    """Return the standard deviations of the chosen samples, if there is one for each sample of the recording."""
    read_sigmas(sigma, name, len(chosen))  # checks them
    shape = np.shape(sigma) if sigma is not None else ()
    return np.asarray(sigma)[chosen] if shape[:1] == chosen.shape and not chosen.all() else sigma


def _route(track: Track, origin: np.ndarray, part: Cut, unit: Units) -> Route:
    """Return the route through the knots of a part, whose positions [units of length] are relative to `origin` [m]."""
    times = part.knots * unit.time
    recorded = to_float64(track.times)
    times[-1] = recorded[-1] - recorded[0]
    orders = [part.states[:, k] * unit.length / unit.time**k for k in range(3)]
    orders[0] = orders[0] + origin
    return Route(*(like(x, track.positions) for x in (times, *orders)))


def _curved(wide: Widened, origin: np.ndarray, curves: Curves, unit: Units) -> Route:
    """Return the window of a route with curves at its stops; `origin` [m] is the first position."""
    starts, c, own = segments(curves, unit)
    recorded = to_float64(wide.track.times)
    arrays = starts, c, np.asarray(recorded[-1] - recorded[0]), origin, own
    route = from_segments(*arrays)
    if wide.track is not wide.inner:
        route = route.window(wide.start, min(wide.end, float(arrays[2])))
    return jax.tree.map(lambda x: like(x, wide.track.positions), route)


def _prediction_error(recording: Recording, problem: Problem, smoothing: float) -> float:
    """Return the RMS distance of every second sample from a route that is fitted to the other samples."""
    fitted = np.arange(len(recording.times)) % 2 == 0
    positions, weights = recording.positions, recording.position_weights[fitted]
    samples = sample_system(problem.positions.part(fitted), positions[fitted], weights)
    # Half of the samples have half of the total weight, so the weight of the jerk is halved, too.
    states = solve(samples.plus(problem.jerk, max(0.5 * smoothing, problem.bridging)).plus(problem.stops))
    errors = predict(problem.positions.part(~fitted), states) - positions[~fitted]
    squares = recording.position_sigmas.part(~fitted).squares(errors)
    return float(np.sqrt(np.mean(squares[recording.weights[~fitted] > 0])))


def _gaps(recording: Recording, knots: np.ndarray) -> Float[np.ndarray, "j 2"]:
    times = recording.times[recording.weights > 0]
    longest = GAP * max(float(np.median(np.diff(knots))), recording.step)
    before = np.flatnonzero(np.diff(times) > longest)
    return np.stack([times[before], times[before + 1]], axis=1)


def _residual(path: Route, track: Track, inliers: np.ndarray) -> Residual:
    """Compare the route with the inliers of the track.

    **Raises:** ValueError if there are too few.
    """
    if inliers.all():
        return compare(path, track)
    if inliers.sum() < MIN_SAMPLES:
        raise ValueError(
            f"only {int(inliers.sum())} of {len(inliers)} samples are not outliers, but at least {MIN_SAMPLES} are "
            "needed: pass a wider window, or standard deviations"
        )
    times = to_float64(track.times)
    start = float(times[inliers][0] - times[0])
    rest = path.window(start, float(path.duration)) if start > 0 else path
    velocities = None if track.velocities is None else to_float64(track.velocities)[inliers]
    return compare(rest, Track(times[inliers], to_float64(track.positions)[inliers], velocities))


def _require(**numbers: float | int | None) -> None:
    for name, value in numbers.items():
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if value is not None and not (number and np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite, but {value!r} was given")
    if sum(numbers.get(name) is not None for name in ("tolerance", "smoothing")) == 2:
        raise ValueError(
            "tolerance and smoothing were both given, but the tolerance determines the smoothing: pass one of the two"
        )
