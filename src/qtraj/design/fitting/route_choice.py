"""How smooth a route shall be: chosen by what it predicts of stretches of a recording that are left out.

The errors of a recording hang together in time, so a sample is predicted best by a route that follows its neighbours'
errors: leaving out single samples chooses no smoothing at all. Of a whole stretch nothing is known but the motion. What
is predicted are the recorded velocities there, or where none are recorded the positions.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.fitting.route_system import Rows, System, of_jerk, of_samples, of_stops, predicted, rows, solved

STRETCH, STEPS = 1.5, 4
"""A stretch that is left out lasts so many seconds, and at least so many steps of time."""

FOLDS, PERIOD = 2, 5
"""Every fifth stretch is left out, twice with other stretches."""

DECADES = 12
"""The search for the smoothing takes at most so many steps, of a factor of ten."""

HELD = 1e8
"""The weight of what is held at a stop, in weights of all samples."""


class Recording(NamedTuple):
    """The samples that count: times (n,) [s], positions (n, 3) about a point of their own, velocities, weights (n,)."""

    times: Float[np.ndarray, " n"]
    positions: Float[np.ndarray, "n 3"]
    velocities: Float[np.ndarray, "n 3"] | None
    weights: Float[np.ndarray, " n"]

    @property
    def step(self) -> float:
        """The median step of time [s]."""
        return float(np.median(np.diff(self.times)))


class Setting(NamedTuple):
    """The systems of a recording on some knots; `left_out` are pairs (samples, their system) for each fold."""

    knots: Float[np.ndarray, " m"]
    at: Rows
    slopes: Rows | None
    whole: System
    jerk: System
    held: System
    left_out: list[tuple[Bool[np.ndarray, " n"], System]]

    def states(self, smoothing: float, without: System | None = None) -> Float[np.ndarray, "m 3 3"]:
        """The joint states for a smoothing, perhaps without some samples."""
        system = self.whole.plus(self.jerk, smoothing).plus(self.held)
        return solved(system if without is None else system.plus(without, -1.0))


def setting(recording: Recording, knots: np.ndarray, standing: np.ndarray, folds: list[np.ndarray]) -> Setting:
    """The systems on `knots`; `standing` (m − 1,) says in which segments the vehicle stands."""
    count, at = len(knots), rows(knots, recording.times)
    slopes = None if recording.velocities is None else rows(knots, recording.times, 1)

    def of(some: np.ndarray) -> System:
        part = Rows(at.segment[some], at.factors[some])
        return of_samples(count, part, recording.positions[some], recording.weights[some])

    everything = np.ones(len(recording.times), bool)
    return Setting(
        knots,
        at,
        slopes,
        of(everything),
        of_jerk(knots),
        of_stops(knots, standing, HELD * float(recording.weights.sum())),
        [(fold, of(fold)) for fold in folds],
    )


def stretches(times: np.ndarray, step: float) -> list[Bool[np.ndarray, " n"]]:
    """Which samples are left out in each fold; the ends of the recording never are."""
    length = max(STRETCH, STEPS * step)
    period = PERIOD * length
    inner = (times > times[0] + length) & (times < times[-1] - length)
    phases = [(times - times[0] - fold * period / FOLDS) % period for fold in range(FOLDS)]
    return [found for found in (inner & (phase < length) for phase in phases) if found.any()]


def score(recording: Recording, of: Setting, smoothing: float) -> float:
    """The mean square of what is predicted wrongly in the stretches that are left out: velocities, or positions."""
    errors = []
    for fold, system in of.left_out:
        states = of.states(smoothing, system)
        if recording.velocities is None or of.slopes is None:
            at, known = of.at, recording.positions
        else:
            at, known = of.slopes, recording.velocities
        part = Rows(at.segment[fold], at.factors[fold])
        squares = np.sum((predicted(part, states) - known[fold]) ** 2, axis=1)
        errors.append(squares * (recording.weights[fold] > 0))
    return float(np.mean(np.concatenate(errors)))


def best_smoothing(recording: Recording, of: Setting, start: float) -> tuple[float, float]:
    """The smoothing with the least score, and the score: bracketed by factors of ten, then by a parabola."""
    known = {k: score(recording, of, start * 10.0**k) for k in (-1, 0, 1)}
    for _ in range(DECADES):
        best = min(known, key=lambda k: known[k])
        if best - 1 in known and best + 1 in known:
            break
        new = best - 1 if best - 1 not in known else best + 1
        known[new] = score(recording, of, start * 10.0**new)
    best = min(known, key=lambda k: known[k])
    if best - 1 not in known or best + 1 not in known:
        return start * 10.0**best, known[best]
    low, middle, high = (np.log(known[best + k]) for k in (-1, 0, 1))
    bend = low + high - 2 * middle
    move = 0.0 if bend <= 0 else float(np.clip(0.5 * (low - high) / bend, -0.5, 0.5))
    return start * 10.0 ** (best + move), known[best]


def within(recording: Recording, of: Setting, start: float, tolerance: float) -> float:
    """The largest smoothing with which the positions are met to a root mean square of `tolerance` [m].

    **Raises:** ValueError where even next to no smoothing leaves more.
    """

    def rms(power: float) -> float:
        offsets = predicted(of.at, of.states(start * 10.0**power)) - recording.positions
        weights = recording.weights
        return float(np.sqrt(np.sum(weights * np.sum(offsets**2, axis=1)) / np.sum(weights)))

    low, high = -DECADES / 2, DECADES / 2
    least = rms(low)
    if least > tolerance:
        raise ValueError(
            f"these knots follow the recording to {least:.3g} m RMS at best, not to {tolerance:.3g} m: "
            "pass a larger tolerance or more knots"
        )
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rms(middle) <= tolerance else (low, middle)
    return start * 10.0**low
