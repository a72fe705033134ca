"""Chooses the smoothing of a fitted route by cross-validation over intervals of the recording.

The errors of a recording are correlated in time. The best prediction of a single sample follows the errors of its
neighbours, so holding out single samples would result in hardly any smoothing. Therefore whole intervals are held out.
The score is the error of the predicted velocities there, or of the positions if no velocities are recorded.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.fitting.route_system import (
    Design,
    System,
    design,
    jerk_system,
    predict,
    sample_system,
    solve,
    stop_system,
)

INTERVAL, STEPS = 1.5, 4
"""Minimum length of a held-out interval: in seconds, and in time steps of the recording."""

FOLDS, PERIOD = 2, 5
"""Number of folds, and the period in intervals: each fold holds out every fifth interval."""

DECADES = 12
"""Maximum number of steps in the search for the smoothing; each is a factor of ten."""

STOP_WEIGHT = 1e8
"""Weight of the equations of a stop, relative to the sum of the weights of all samples."""


class Recording(NamedTuple):
    """Samples: times (n,) [s], positions (n, 3) relative to the first one, velocities (n, 3), weights (n,)."""

    times: Float[np.ndarray, " n"]
    positions: Float[np.ndarray, "n 3"]
    velocities: Float[np.ndarray, "n 3"] | None
    weights: Float[np.ndarray, " n"]

    @property
    def step(self) -> float:
        """The median time step [s]."""
        return float(np.median(np.diff(self.times)))


class Problem(NamedTuple):
    """The least-squares problem of a recording on some knots, without the smoothing.

    `positions` and `velocities` are design matrices; `samples`, `jerk` and `stops` are systems; `folds` are pairs of
    the samples that a fold holds out and their system.
    """

    knots: Float[np.ndarray, " m"]
    positions: Design
    velocities: Design | None
    samples: System
    jerk: System
    stops: System
    folds: list[tuple[Bool[np.ndarray, " n"], System]]

    def system(self, smoothing: float) -> System:
        """The normal equations of all samples."""
        return self.samples.plus(self.jerk, smoothing).plus(self.stops)

    def states(self, smoothing: float, without: System | None = None) -> Float[np.ndarray, "m 3 3"]:
        """The states at the knots, optionally without the samples of a system."""
        system = self.system(smoothing)
        return solve(system if without is None else system.plus(without, -1.0))


def problem(recording: Recording, knots: np.ndarray, is_stop: np.ndarray, folds: list[np.ndarray]) -> Problem:
    """The least-squares problem on `knots`, with stops in the segments where `is_stop` (m − 1,)."""
    positions = design(knots, recording.times)
    velocities = None if recording.velocities is None else design(knots, recording.times, 1)

    def system(samples: np.ndarray) -> System:
        at, weights = positions.part(samples), recording.weights[samples]
        return sample_system(len(knots), at, recording.positions[samples], weights)

    stops = stop_system(knots, is_stop, STOP_WEIGHT * float(recording.weights.sum()))
    everything = np.ones(len(recording.times), bool)
    parts = [(fold, system(fold)) for fold in folds]
    return Problem(knots, positions, velocities, system(everything), jerk_system(knots), stops, parts)


def folds(times: np.ndarray, step: float) -> list[Bool[np.ndarray, " n"]]:
    """The samples that each fold holds out; the two ends of the recording are never held out."""
    length = max(INTERVAL, STEPS * step)
    period = PERIOD * length
    inner = (times > times[0] + length) & (times < times[-1] - length)
    phases = [(times - times[0] - fold * period / FOLDS) % period for fold in range(FOLDS)]
    return [fold for fold in (inner & (phase < length) for phase in phases) if fold.any()]


def score(recording: Recording, of: Problem, smoothing: float) -> float:
    """The mean square error of the velocities, or else of the positions, in the held-out intervals."""
    errors = []
    for fold, system in of.folds:
        states = of.states(smoothing, system)
        if recording.velocities is None or of.velocities is None:
            at, recorded = of.positions, recording.positions
        else:
            at, recorded = of.velocities, recording.velocities
        squares = np.sum((predict(at.part(fold), states) - recorded[fold]) ** 2, axis=1)
        errors.append(squares * (recording.weights[fold] > 0))
    return float(np.mean(np.concatenate(errors)))


def best_smoothing(recording: Recording, of: Problem, start: float) -> tuple[float, float]:
    """The smoothing with the smallest score, and that score, by a bracket of powers of ten and then a parabola."""
    scores = {k: score(recording, of, start * 10.0**k) for k in (-1, 0, 1)}
    for _ in range(DECADES):
        best = min(scores, key=lambda k: scores[k])
        if best - 1 in scores and best + 1 in scores:
            break
        new = best - 1 if best - 1 not in scores else best + 1
        scores[new] = score(recording, of, start * 10.0**new)
    best = min(scores, key=lambda k: scores[k])
    if best - 1 not in scores or best + 1 not in scores:
        return start * 10.0**best, scores[best]
    low, middle, high = (np.log(scores[best + k]) for k in (-1, 0, 1))
    curvature = low + high - 2 * middle
    shift = 0.0 if curvature <= 0 else float(np.clip(0.5 * (low - high) / curvature, -0.5, 0.5))
    return start * 10.0 ** (best + shift), scores[best]


def largest_smoothing(recording: Recording, of: Problem, start: float, tolerance: float) -> float:
    """The largest smoothing for which the RMS distance does not exceed `tolerance` [m].

    **Raises:** ValueError if the RMS distance exceeds `tolerance` even with negligible smoothing.
    """

    def rms(power: float) -> float:
        offsets = predict(of.positions, of.states(start * 10.0**power)) - recording.positions
        weights = recording.weights
        return float(np.sqrt(np.sum(weights * np.sum(offsets**2, axis=1)) / np.sum(weights)))

    low, high = -DECADES / 2, DECADES / 2
    min_rms = rms(low)
    if min_rms > tolerance:
        raise ValueError(
            f"the best route with these knots has an RMS distance of {min_rms:.3g} m from the recording, more than the "
            f"tolerance of {tolerance:.3g} m: pass a larger tolerance or more knots"
        )
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rms(middle) <= tolerance else (low, middle)
    return start * 10.0**low
