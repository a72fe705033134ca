"""Choose the smoothing of a fitted route by cross-validation over intervals of the recording.

The errors of a recording are correlated in time. The best prediction of a single sample follows the errors of its
neighbours, so holding out single samples would result in hardly any smoothing. Therefore whole intervals are held out.
The score is the mean square error of the velocities predicted in these intervals, or of the positions if no velocities
are recorded.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_sigmas import Sigmas
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
"""Minimum length of a held-out interval, in units of time and in time steps; the longer one applies."""

FOLDS, PERIOD = 2, 5
"""Number of folds, and the period in intervals: each fold holds out every fifth interval."""

OFF_GRID = 0.382
"""Shift of the intervals in time steps: no sample is at the end of an interval, where rounding would decide."""

DECADES = 12
"""Maximum number of steps by a factor of ten in the search for the best smoothing.

With a tolerance, this is the range of the search for the largest smoothing, in decades.
"""

BRIDGE = 1e-10
"""Minimum weight of the jerk, relative to the samples of a segment, where held-out samples leave a gap."""

STOP_WEIGHT = 1e8
"""Weight of the equations of a stop, relative to the weights of the samples of a segment."""


class Fold(NamedTuple):
    """The k held-out samples of a fold.

    `system` contains the normal equations of their positions. The score compares the recorded `values` (k, 3) with the
    prediction of the design matrix `at`. The values are velocities, or positions if no velocities were recorded.
    `weights` (k,) are 0 for outliers.
    """

    system: System
    at: Design
    values: Float[np.ndarray, "k 3"]
    sigmas: Sigmas
    weights: Float[np.ndarray, " k"]


class Problem(NamedTuple):
    """The least-squares problem of a recording for given knots and any smoothing.

    `positions` is the design matrix of the positions. `samples`, `jerk` and `stops` are the normal equations of the
    samples, of the squared jerk and of the stops. `folds` contains the held-out samples of each fold. `sense` (m − 1,)
    is the direction of the segments (see `qtraj.path.pieces.hermite`); None means forwards.
    """

    knots: Float[np.ndarray, " m"]
    positions: Design
    samples: System
    jerk: System
    stops: System
    folds: list["Fold"]
    sense: Float[np.ndarray, " segments"] | None = None

    def system(self, smoothing: float) -> System:
        """Return the normal equations of the whole problem."""
        return self.samples.plus(self.jerk, smoothing).plus(self.stops)

    def states(self, smoothing: float, without: System | None = None) -> Float[np.ndarray, "m 3 3"]:
        """Return the states at the knots, optionally without the samples in the normal equations `without`."""
        if without is None:
            return solve(self.system(smoothing))
        return solve(self.system(max(smoothing, self.bridging)).plus(without, -1.0))

    @property
    def bridging(self) -> float:
        """The smallest smoothing that determines the states in a gap."""
        return BRIDGE * float(np.median(np.diff(self.knots))) ** 5 * len(self.positions.segment) / len(self.knots)


def problem(
    recording: Recording,
    knots: np.ndarray,
    is_stop: np.ndarray,
    folds: list[np.ndarray],
    stiffness: np.ndarray | float = 1.0,
    sense: np.ndarray | None = None,
) -> Problem:
    """Build the least-squares problem for `knots` (m,), where `is_stop` (m − 1,) marks the segments that are stops.

    `stiffness` (m − 1,) are weights of the jerk in the segments, and `sense` (m − 1,) is their direction.
    """
    positions = design(knots, recording.times, sense=sense)

    def held_out(fold: np.ndarray) -> Fold:
        at = positions.part(fold)
        system = sample_system(at, recording.positions[fold], recording.position_weights[fold])
        values, sigmas = recording.positions, recording.position_sigmas
        if recording.velocities is not None:
            rates = None if recording.rates is None else recording.rates[fold]
            at = design(knots, recording.times[fold], 1, sense).scaled(rates)
            values, sigmas = recording.velocities, recording.velocity_sigmas
        return Fold(system, at, values[fold], sigmas.part(fold), recording.weights[fold])

    samples = sample_system(positions, recording.positions, recording.position_weights)
    stops = stop_system(knots, is_stop, STOP_WEIGHT * float(recording.weights.sum()) / len(is_stop))
    parts = [held_out(fold) for fold in folds]
    return Problem(knots, positions, samples, jerk_system(knots, stiffness, sense), stops, parts, sense)


def folds(times: np.ndarray, step: float) -> list[Bool[np.ndarray, " n"]]:
    """Return, for each fold, a mask of the held-out samples; the two ends of the recording are never held out."""
    length = max(INTERVAL, STEPS * step)
    period = PERIOD * length
    after = times - times[0] + OFF_GRID * step
    inner = (after > length) & (after < times[-1] - times[0] - length)
    phases = [(after - fold * period / FOLDS) % period for fold in range(FOLDS)]
    return [fold for fold in (inner & (phase < length) for phase in phases) if fold.any()]


def score(of: Problem, smoothing: float) -> float:
    """Return the weighted mean square error of the velocities (or of the positions) in the held-out intervals."""
    errors = []
    for fold in of.folds:
        squares = fold.sigmas.squares(predict(fold.at, of.states(smoothing, fold.system)) - fold.values)
        errors.append(squares * (fold.weights > 0))
    return float(np.mean(np.concatenate(errors)))


def position_score(recording: Recording, of: Problem, smoothing: float, folds: list[np.ndarray]) -> float:
    """Return the weighted mean square error of the positions in the held-out intervals."""
    errors = []
    for mask, fold in zip(folds, of.folds, strict=True):
        offsets = predict(of.positions.part(mask), of.states(smoothing, fold.system)) - recording.positions[mask]
        errors.append(recording.position_sigmas.part(mask).squares(offsets) * (fold.weights > 0))
    return float(np.mean(np.concatenate(errors)))


def best_smoothing(of: Problem, start: float) -> tuple[float, float]:
    """Return the smoothing with the smallest score, and the smallest computed score.

    Powers of ten bracket the minimum; a parabola through the logarithms of three scores refines the smoothing.
    """
    scores = {k: score(of, start * 10.0**k) for k in (-1, 0, 1)}
    for _ in range(DECADES):
        best = min(scores, key=lambda k: scores[k])
        if best - 1 in scores and best + 1 in scores:
            break
        new = best - 1 if best - 1 not in scores else best + 1
        scores[new] = score(of, start * 10.0**new)
    best = min(scores, key=lambda k: scores[k])
    at_bound = best - 1 not in scores or best + 1 not in scores
    if at_bound or scores[best] == 0:  # a vehicle that never moves is predicted exactly, and log(0) is not finite
        return start * 10.0**best, scores[best]
    low, middle, high = (np.log(scores[best + k]) for k in (-1, 0, 1))
    curvature = low + high - 2 * middle
    shift = 0.0 if curvature <= 0 else float(np.clip(0.5 * (low - high) / curvature, -0.5, 0.5))
    return start * 10.0 ** (best + shift), scores[best]


def largest_smoothing(recording: Recording, of: Problem, start: float, tolerance: float) -> float:
    """Return the largest smoothing for which the RMS distance does not exceed `tolerance`, in units of length.

    The search covers six decades below and six decades above `start`.

    **Raises:** ValueError if the RMS distance exceeds `tolerance` even with negligible smoothing.
    """

    def rms(power: float) -> float:
        offsets = predict(of.positions, of.states(start * 10.0**power)) - recording.positions
        weights = recording.weights
        return float(np.sqrt(np.sum(weights * np.sum(offsets**2, axis=1)) / np.sum(weights)))

    low, high = -DECADES / 2, DECADES / 2
    min_rms = rms(low)
    if min_rms > tolerance:
        unit = recording.units.length
        raise ValueError(
            f"the best route with these knots has an RMS distance of {min_rms * unit:.3g} m from the recording, more "
            f"than the tolerance of {tolerance * unit:.3g} m: pass a larger tolerance or more knots"
        )
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rms(middle) <= tolerance else (low, middle)
    return start * 10.0**low
