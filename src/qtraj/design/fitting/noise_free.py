"""Recognise recordings without noise, such as samples of a formula, which need no smoothing.

Smoothing by the jerk imposes zero jerk at both ends. On a recording with noise, this costs less than the noise does. On
a recording without noise it is the only error, and cross-validation does not notice it, because the ends are never held
out.
"""

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_jumps import lengths
from qtraj.design.fitting.route_knots import SPACING, equal_knots
from qtraj.design.fitting.route_system import WIDTH, design, jerk_system, predict, sample_system, solve

STEPS, LEAST = 10, 5
"""Initial and minimum knot spacing in time steps of the recording; a knot has three unknowns, so noise would leave
residuals."""

COARSE = 4
"""Factor of the first spacing: the farther apart the knots are, the smaller are the rounding errors of derivatives."""

ENOUGH = 4
"""Minimum number of samples of a segment."""

ORDER = 6
"""Order of the fit's error in the knot spacing."""

EXACT = 1e-6
"""Maximum RMS distance of the samples, relative to the median distance between consecutive samples."""

BETTER = 8.0
"""Factor by which half the spacing must decrease the distance to be chosen; rounding errors do not decrease."""

NEGLIGIBLE = 1e-16
"""Weight of the jerk, relative to the samples of a segment: too small to be noticed, but no matrix is singular."""


def without_smoothing(recording: Recording) -> tuple[Float[np.ndarray, " m"], float] | None:
    """Return knots and a negligible smoothing for a recording without noise, or None if there is noise or a gap.

    The knot spacing is halved as long as the samples of a smooth function would be met in the end, and then as long as
    this decreases the distance.
    """
    duration = float(recording.times[-1])
    if len(recording.times) < 2 * WIDTH:
        return None
    spacing = COARSE * max(SPACING, STEPS * recording.step)
    step = float(np.median(lengths(np.diff(recording.positions, axis=0))))
    found, best = None, EXACT * step
    while True:
        knots = equal_knots(duration, spacing)
        if np.histogram(recording.times, knots)[0].min() < ENOUGH:
            return found
        smoothing, distance = _fit(recording, knots)
        if distance <= best:
            found, best = (knots, smoothing), distance / BETTER
        finest = distance * (LEAST * recording.step / spacing) ** ORDER
        if (found is not None and distance > best * BETTER) or finest > EXACT * step:
            return found
        if spacing < 2 * LEAST * recording.step:
            return found
        spacing /= 2


def _fit(recording: Recording, knots: Float[np.ndarray, " m"]) -> tuple[float, float]:
    """Return the negligible smoothing and the RMS distance [m] of the samples from the fit."""
    at, spacing = design(knots, recording.times), knots[1] - knots[0]
    smoothing = NEGLIGIBLE * spacing**5 * len(recording.times) / len(knots)
    samples = sample_system(at, recording.positions, recording.position_weights)
    states = solve(samples.plus(jerk_system(knots), smoothing))
    return smoothing, float(np.sqrt(np.mean(lengths(predict(at, states) - recording.positions) ** 2)))
