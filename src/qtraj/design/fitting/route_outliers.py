"""Samples that are no measurement: positions that are wrong by far more than the others."""

from typing import Any

import numpy as np

from qtraj.design.fitting.route_choice import Recording
from qtraj.design.fitting.route_knots import even
from qtraj.design.fitting.route_system import of_jerk, of_samples, predicted, rows, solved
from qtraj.foundation.arrays import as_float, concrete, require_positive

SPACING, STEPS = 1.0, 2
"""Knots stand so many seconds apart at first, and at least so many steps of time."""

SMOOTHING = 1e-4
"""The first smoothing to try [s⁶], divided by the median step of time [s]."""

FAR = 10.0
"""A sample farther from the route than so many times the upper quartile of all distances is an outlier."""

ROUNDS, NARROWER = 12, 0.3
"""Searches for outliers; by the second the bound is narrower in each, until it is `FAR`."""

ENDS = 1e-6
"""Of the duration: as well must given knots begin and end with the recording."""

LEAST = 1e-8
"""[m] Of noiseless samples this stands for the quartile: rounding."""


def without_outliers(recording: Recording, knots: Any) -> tuple[Recording, float, np.ndarray | None]:
    """The recording with outliers weighing nothing; the spacing of knots to begin with; and the knots if given.

    First a bound far above all others is laid, then it comes down: so the worst samples go before they can bend the
    route towards them.
    """
    duration = float(recording.times[-1])
    spacing, given = max(SPACING, STEPS * recording.step), None
    if knots is not None:
        asked = np.asarray(concrete(knots), float)
        if asked.ndim == 0:
            require_positive(as_float(asked), "knots", "s")
            spacing = min(float(asked), duration)
            given = even(duration, spacing)
        else:
            given = _knots(asked, duration)
            spacing = float(np.median(np.diff(given)))
    grid = even(duration, spacing) if given is None else given
    at, jerk, bound = rows(grid, recording.times), of_jerk(grid), np.inf
    rest = jerk.plus(jerk, SMOOTHING / recording.step - 1.0)
    for _ in range(ROUNDS):
        states = solved(of_samples(len(grid), at, recording.positions, recording.weights).plus(rest))
        away = np.linalg.norm(predicted(at, states) - recording.positions, axis=1)
        counted = recording.weights > 0
        least = bound_of(away[counted])
        bound = max(least, NARROWER * min(bound, away[counted].max()))
        weights = (away <= bound).astype(float)
        if bound == least and np.array_equal(weights, recording.weights):
            break
        recording = recording._replace(weights=weights)
    return recording, spacing, given


def bound_of(away: np.ndarray) -> float:
    """The distance from which on samples are outliers [m]."""
    return FAR * max(float(np.quantile(away, 0.75)), LEAST)


def _knots(asked: np.ndarray, duration: float) -> np.ndarray:
    inner = asked.ndim == 1 and len(asked) > 1 and np.all(np.diff(asked) > 0)
    if not inner or abs(asked[0]) > ENDS * duration or abs(asked[-1] - duration) > ENDS * duration:
        raise ValueError(
            f"knots must be a spacing [s], or times that increase from 0 to the duration {duration:.9g} s, "
            f"but {asked.tolist() if asked.size < 8 else f'{asked.size} numbers'} was given"
        )
    return np.concatenate([[0.0], asked[1:-1], [duration]])
