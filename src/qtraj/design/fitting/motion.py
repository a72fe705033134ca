"""The motion of a drive as a fit in time describes it, with its own scales and with the noise of the fit."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.route_jumps import lengths
from qtraj.design.fitting.route_system import design, predict
from qtraj.design.fitting.units import SHARE, TURN

LAGS = 2.0 ** np.arange(-3, 4)
"""Times, in units of the recording, in which the velocity may change by `TURN`."""


class Noise(NamedTuple):
    """Standard deviations, per axis, of the samples and of the velocity and the acceleration of a fit."""

    position: float
    velocity: float
    acceleration: float


def noise_of(sigma: float, smoothing: float, step: float, knots: Float[np.ndarray, " m"]) -> Noise:
    """Return the noise of a fit to positions with standard deviation `sigma` and this time `step`.

    The variances are those of a fit without ends to a motion whose jerk is white noise: the integrals over the angular
    frequency ω of ω² and ω⁴, times sigma²·step/π/(1 + (ω/c)⁶), where c⁶ = 1/(smoothing·step). Such a fit has c/3
    parameters per unit of time, but not more than the knots and the samples.
    """
    parameters = min(3 / float(np.median(np.diff(knots))), 1 / step)
    cutoff = min((smoothing * step) ** (-1 / 6), 3 * parameters)
    density = sigma * np.sqrt(step)
    return Noise(sigma, density * np.sqrt(cutoff**3 / 6), density * np.sqrt(cutoff**5 / 3))


class Motion(NamedTuple):
    """A fit in time: the states (m, 3, 3) at its knots (m,), and its slow points as intervals (start, end).

    The interval of a stop has a duration; that of another slow point has none.
    """

    knots: Float[np.ndarray, " m"]
    states: Float[np.ndarray, "m 3 3"]
    stops: list[tuple[float, float]]
    noise: Noise

    @property
    def ends(self) -> tuple[float, float]:
        """The first and the last knot."""
        return float(self.knots[0]), float(self.knots[-1])

    def at(self, t: np.ndarray, order: int = 0) -> Float[np.ndarray, "n 3"]:
        """Return the positions (order 0) or derivatives of another order at increasing times."""
        return predict(design(self.knots, t, order), self.states)


def straight_motion(motion: Motion) -> tuple[float, float]:
    """Return how long and how far the vehicle drives almost straight.

    Unlike the units of the recording, they depend neither on the noise nor on the time step of the recording.
    """
    start, end = motion.ends
    count = max(int((end - start) / LAGS[0]), 1)
    velocities = motion.at(np.linspace(start, end, count + 1), 1)
    step, moving = (end - start) / count, lengths(velocities) > 0
    speed = float(np.quantile(lengths(velocities[moving]), SHARE)) if moving.any() else 0.0
    lags = [int(lag) for lag in LAGS / LAGS[0] if lag < count]
    changes = [_change(velocities, moving, lag) for lag in lags]
    within = np.array(changes) <= TURN * speed
    time = step * (lags[-1] if lags else 1)
    if lags and not within.all():
        k = int(np.argmin(within))
        time = step * lags[k] * TURN * speed / changes[k]  # the change grows like the time
    return time, speed * time


def _change(velocities: np.ndarray, moving: np.ndarray, lag: int) -> float:
    """Return the usual change of the velocity of a moving vehicle in a number of steps."""
    either = moving[lag:] | moving[:-lag]
    changes = lengths(velocities[lag:] - velocities[:-lag])[either]
    return float(np.quantile(changes, SHARE)) if len(changes) else 0.0
