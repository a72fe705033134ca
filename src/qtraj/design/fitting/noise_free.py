"""Recognise recordings without noise, such as samples of a formula, which need no smoothing.

Smoothing by the jerk imposes zero jerk at both ends. On a recording with noise, this costs less than the noise does. On
a recording without noise it is the only error, and cross-validation does not notice it, because the ends are never held
out.
"""

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.route_choice import Recording
from qtraj.design.fitting.route_knots import equal_knots
from qtraj.design.fitting.route_outliers import SPACING, lengths
from qtraj.design.fitting.route_system import WIDTH, design, jerk_system, predict, sample_system, solve

STEPS = 10
"""Minimum knot spacing in time steps of the recording; a knot has three unknowns, so noise would leave residuals."""

EXACT = 1e-6
"""Maximum RMS distance of the samples, relative to the median distance between consecutive samples."""

NEGLIGIBLE = 1e-16
"""Weight of the jerk, relative to the samples of a segment: it determines the states where there are few samples."""


def without_smoothing(recording: Recording) -> tuple[Float[np.ndarray, " m"], float] | None:
    """Return knots and a negligible smoothing for a recording without noise, or None if there is noise."""
    duration = float(recording.times[-1])
    knots = equal_knots(duration, max(SPACING, STEPS * recording.step))
    if len(recording.times) < 2 * WIDTH:
        return None
    at, spacing = design(knots, recording.times), knots[1] - knots[0]
    smoothing = NEGLIGIBLE * spacing**5 * len(recording.times) / len(knots)
    samples = sample_system(at, recording.positions, recording.position_weights)
    try:
        states = solve(samples.plus(jerk_system(knots), smoothing))
    except np.linalg.LinAlgError:  # a segment without samples
        return None
    distances = lengths(predict(at, states) - recording.positions)
    step = float(np.median(lengths(np.diff(recording.positions, axis=0))))
    return (knots, smoothing) if np.sqrt(np.mean(distances**2)) <= EXACT * step else None
