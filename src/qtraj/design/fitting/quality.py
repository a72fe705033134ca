"""The quality of a fit: relative misfits, and the thresholds above which a fit is loose or poor."""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from qtraj.foundation.outcome import ResultCode
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track, chord_marks, elapsed_times, to_float64


class Quality(NamedTuple):
    """Relative misfits of a fit.

    `rms`: the RMS horizontal distance divided by the radius of the turn. `speed`: the largest speed difference divided
    by the RMS recorded speed.
    """

    rms: float
    speed: float


LOOSE, POOR = Quality(0.03, 0.25), Quality(0.10, 0.50)
"""Thresholds above which a fit is loose (a warning) and poor (a failure)."""


def speed_misfit(path: SpiralHelix, track: Track) -> float:
    """Return the largest speed difference divided by the RMS recorded speed.

    Without recorded velocities, the mean speeds along chords are compared, because they are less sensitive to noise
    than the speeds between successive samples.
    """
    times = elapsed_times(track)
    if track.velocities is not None:
        return _relative_difference(
            np.linalg.norm(_states(path, times)[1], axis=1), _lengths(to_float64(track.velocities))
        )
    marks = chord_marks(len(times))
    seconds = np.diff(times[marks])
    fitted, recorded = (np.diff(x[marks], axis=0) for x in (_states(path, times)[0], to_float64(track.positions)))
    return _relative_difference(_lengths(fitted) / seconds, _lengths(recorded) / seconds)


def judge(quality: Quality) -> ResultCode:
    """Return the result code of a fit with these misfits: successful, loose or poor."""
    if not all(misfit <= threshold for misfit, threshold in zip(quality, POOR, strict=True)):
        return ResultCode.poor_fit
    if not all(misfit <= threshold for misfit, threshold in zip(quality, LOOSE, strict=True)):
        return ResultCode.loose_fit
    return ResultCode.successful


def _relative_difference(fitted: np.ndarray, recorded: np.ndarray) -> float:
    return float(np.max(np.abs(fitted - recorded)) / np.sqrt(np.mean(recorded**2)))


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=1)


def _states(path: SpiralHelix, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions relative to the axis [m] and the velocities in the moving basis [m/s], (n, 3) each."""
    rho, phi, height = (Polynomial(np.asarray(x, np.float64)) for x in (path.radius, path.angle, path.height))
    radius, angle = rho(times), phi(times)
    positions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height(times)], axis=1)
    velocities = [rho.deriv()(times), radius * phi.deriv()(times), height.deriv()(times)]
    return positions, np.stack([np.broadcast_to(v, times.shape) for v in velocities], axis=1)
