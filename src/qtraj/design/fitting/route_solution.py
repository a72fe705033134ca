"""Solve for the states at the knots of a fitted route, with recorded velocities and without outliers."""

from typing import NamedTuple

import numpy as np

from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_choice import Problem
from qtraj.design.fitting.route_jumps import at_rest, jumps
from qtraj.design.fitting.route_outliers import outlier_bound, outliers
from qtraj.design.fitting.route_system import design, predict, sample_system, solve


class Solution(NamedTuple):
    """The solution of a fit.

    The axes of `states` (m, 3, 3) are the knot, the order of the derivative (position, velocity, acceleration), and the
    component. `sigma` is the standard deviation of the position errors per axis. `matrix` contains the diagonals of
    the matrix of the normal equations.
    """

    states: np.ndarray
    sigma: float
    matrix: np.ndarray


def solution(recording: Recording, problem: Problem, smoothing: float) -> Solution:
    """Fit the states to the positions and the recorded velocities.

    The weight of the velocities is the variance of the position errors divided by the variance of the velocity errors.
    Variances that were not given are estimated from the residuals of a fit to the positions only.
    """
    inliers, system = recording.weights > 0, problem.system(smoothing)
    states = solve(system)
    offsets = (predict(problem.positions, states) - recording.positions)[inliers]
    sigma = recording.position_sigmas.unit or float(np.sqrt(np.mean(offsets**2)))
    if recording.velocities is not None:
        velocities = design(problem.knots, recording.times, 1, problem.sense).scaled(recording.rates)
        velocity_errors = (predict(velocities, states) - recording.velocities)[inliers]
        velocity_sigma = recording.velocity_sigmas.unit or float(np.sqrt(np.mean(velocity_errors**2)))
        weights = recording.velocity_sigmas.of(sigma**2 / max(velocity_sigma**2, 1e-30) * recording.weights)
        system = system.plus(sample_system(velocities, recording.velocities, weights))
        states = solve(system)
    return Solution(_with_exact_stops(states, problem), max(sigma, 1e-12), system.matrix)


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


def with_inliers(
    recording: Recording, problem: Problem, smoothing: float, found: Solution
) -> tuple[Recording, Solution]:
    """Find the outliers again with the final smoothing, and repeat the fit if the set of outliers has changed.

    The previous outliers were found with the initial smoothing.
    """
    if (recording.weights > 0).all():
        return recording, found
    residuals = recording.position_sigmas.scaled(predict(problem.positions, found.states) - recording.positions)
    bound = outlier_bound(np.linalg.norm(residuals[(recording.weights > 0) & ~at_rest(recording)], axis=1))
    weights = (~outliers(residuals, jumps(recording), bound)).astype(float)
    if np.array_equal(weights, recording.weights):
        return recording, found
    recording = recording._replace(weights=weights)
    samples = sample_system(problem.positions, recording.positions, recording.position_weights)
    return recording, solution(recording, problem._replace(samples=samples), smoothing)
