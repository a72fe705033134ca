"""Fit a drive in the time: choose its knots and its smoothing, and find its outliers and its stops."""

from typing import NamedTuple

import numpy as np

from qtraj.design.fitting import route_choice as choice
from qtraj.design.fitting.motion import Motion, noise_of
from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_choice import Problem
from qtraj.design.fitting.route_knots import Grid, equal_knots, with_stops, without_gaps
from qtraj.design.fitting.route_outliers import SMOOTHING
from qtraj.design.fitting.route_solution import Solution, solution, with_inliers
from qtraj.design.fitting.route_stops import Standing, find_stops, stops_in_noise

MAX_HALVINGS, MIN_GAIN = 3, 0.03
"""Maximum number of halvings of the knot spacing, and the minimum relative decrease of the score by a halving."""


class Choice(NamedTuple):
    """The first knots, and the given tolerance or smoothing; what is None is chosen. All in units of the recording.

    `ends` are the ends of a window, which are knots, too.
    """

    grid: Grid
    tolerance: float | None
    smoothing: float | None
    ends: tuple[float, ...] = ()


class InTime(NamedTuple):
    """A fit in time: the recording with its outliers, the problem, its solution, and the motion with its stops.

    `stretch_error` is the RMS position error in held-out intervals.
    """

    recording: Recording
    problem: Problem
    smoothing: float
    stretch_error: float
    found: Solution
    motion: Motion


def fit_in_time(recording: Recording, standing: Standing, given: Choice, in_noise: Choice | None) -> InTime:
    """Return the fit of a drive with its stops, which depend on the noise of a first fit unless `in_noise` is None.

    `in_noise` is a choice without a tolerance, a smoothing or given knots: only its residuals are noise.
    """
    stops = find_stops(recording, standing)
    first = _with_stops(recording, stops, given)
    if in_noise is None:
        return first
    noisy = first if in_noise is given else _with_stops(first.recording, stops, in_noise)
    stops = stops_in_noise(noisy.recording, standing, noisy.motion)
    return first if stops in (None, first.motion.stops) else _with_stops(first.recording, stops, given)


def _with_stops(recording: Recording, stops: list[tuple[float, float]], given: Choice) -> InTime:
    problem, best, stretch_error = _chosen(recording, stops, given)
    recording, found = with_inliers(recording, problem, best, solution(recording, problem, best))
    motion = Motion(problem.knots, found.states, stops, noise_of(found.sigma, best, recording.step, problem.knots))
    return InTime(recording, problem, best, stretch_error, found, motion)


def _chosen(recording: Recording, stops: list[tuple[float, float]], given: Choice) -> tuple[Problem, float, float]:
    """Return the problem on the chosen knots, the smoothing, and the RMS position error in held-out intervals.

    The error is NaN if the recording is too short for held-out intervals.
    """
    duration, start = float(recording.times[-1]), SMOOTHING / recording.step
    folds = choice.folds(recording.times, recording.step)

    def on(knots: np.ndarray) -> Problem:
        return choice.problem(recording, *with_stops(knots, stops, given.ends), folds)

    grid, spacing, fixed = given.grid
    problem = on(grid)
    if given.smoothing is not None:
        best = given.smoothing
    elif given.tolerance is not None:
        best = choice.largest_smoothing(recording, problem, start, given.tolerance)
    elif not folds:
        best = start
    else:
        best, min_score = choice.best_smoothing(problem, start)
        for _ in range(0 if fixed else MAX_HALVINGS):
            spacing /= 2
            finer = on(without_gaps(equal_knots(duration, spacing), recording.times))
            if choice.score(finer, best) > min_score * (1 - MIN_GAIN):
                break
            problem = finer
            best, min_score = choice.best_smoothing(problem, best)
    stretch_error = float(np.sqrt(choice.position_score(recording, problem, best, folds))) if folds else np.nan
    return problem, best, stretch_error
