"""Brake from a speed to a given speed and acceleration at a given distance, with a bounded jerk if it is limited.

The vehicle brakes with a constant deceleration. With a limit on the jerk, the acceleration along the path then changes
at a constant rate to the given one. Two of these numbers follow from the given ones: the deceleration and the place at
which it begins to decrease, or the deceleration and the rate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

BISECTIONS, SECANTS, ROUNDINGS = 60, 20, 1e-15
"""Number of halvings of an interval with the solution of an equation, largest number of steps of the secant method, and
the relative error of a distance at which these end."""

Places = Float[np.ndarray, "*n"]


class Met(NamedTuple):
    """What a timing has at knots: squared speeds [m²/s²], accelerations along the path [m/s²], and distances [m]."""

    squares: Places
    accelerations: Places
    places: Places

    def at(self, k: int) -> Met:
        """Return the values at one knot."""
        return Met(*(x[k] for x in self))


class Deceleration(NamedTuple):
    """A squared speed `start` [m²/s²], and a constant deceleration `strength` [m/s²] up to a `place` [m].

    From there on, the acceleration along the path increases at the rate `jerk` [m/s³], for the `time` [s].
    """

    start: float
    strength: float
    place: float = np.inf
    jerk: float = 0.0
    time: float = 0.0

    def at(self, places: Places) -> tuple[Places, Places, Places]:
        """Return the squared speeds, the accelerations along the path, and their rates of change, at distances [m].

        At `place` itself, the rate is zero.
        """
        squares, accelerations = self.start - 2 * self.strength * places, np.full(places.shape, -self.strength)
        ramp = places > self.place
        if ramp.any():
            v = np.sqrt(max(self.start - 2 * self.strength * self.place, 0.0))
            t = self._times(v, places[ramp] - self.place)
            squares[ramp] = (v + t * (0.5 * self.jerk * t - self.strength)) ** 2
            accelerations[ramp] += self.jerk * t
        return squares, accelerations, np.where(ramp, self.jerk, 0.0)

    def _times(self, v: float, distances: Places) -> Places:
        """Return the times in which the vehicle covers `distances` from `place`, where its speed is `v`."""
        low, high = np.zeros(distances.shape), np.full(distances.shape, self.time * (1 + 1e-9))
        for _ in range(BISECTIONS):
            t = 0.5 * (low + high)
            beyond = t * (v + t * (t * self.jerk / 6 - self.strength / 2)) > distances
            low, high = np.where(beyond, low, t), np.where(beyond, t, high)
        return 0.5 * (low + high)


def distances(start: float, strength: Any, jerk: float, met: Met) -> Any:
    """Return the distances after which a vehicle that brakes has the speeds and accelerations `met`, or infinity.

    `start` is the squared speed at the start, `strength` the constant deceleration, and `jerk` the rate at which it
    ends. If both are too large for the change of the speed, the vehicle brakes less.
    """
    v, end = np.sqrt(start), np.sqrt(np.maximum(met.squares, 0.0))
    change, own = v - end, np.maximum(met.accelerations, 0.0)
    with np.errstate(all="ignore"):
        strength = np.minimum(strength, np.sqrt(met.accelerations**2 + 2 * jerk * change))
        ramp = (strength + met.accelerations) / jerk
        steady = np.maximum(change - 0.5 * (strength - met.accelerations) * ramp, 0.0) / strength
        middle = v - strength * steady
        covered = 0.5 * (v + middle) * steady + ramp * (middle + ramp * (met.accelerations - 2 * strength) / 6)
        possible = (change > 0) & (ramp >= 0) & (strength > 0) & (end > 0.5 * own * own / jerk)
    return np.where(possible, covered, np.inf)


def constant(start: float, strongest: float, met: Met) -> tuple[int, Deceleration] | None:
    """Return the first knot at which a vehicle can be slow enough, and the constant deceleration with which it is."""
    k = int(np.argmax(met.squares >= start - 2 * strongest * met.places))
    if not (k > 0 and met.squares[k] > 0):
        return None
    return k, Deceleration(start, float((start - met.squares[k]) / (2 * met.places[k])))


def gradual(start: float, strongest: float, jerk: float, met: Met) -> tuple[int, Deceleration] | None:
    """Return the same with a deceleration that ends at the rate `jerk`, so that the acceleration does not jump."""
    reached = distances(start, strongest, jerk, met) <= met.places
    k = int(np.argmax(reached))
    if not (reached[k] and k > 0):
        return None
    own = met.at(k)
    low, high = max(0.0, -float(own.accelerations)), strongest
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        near = distances(start, middle, jerk, own) <= own.places
        low, high = (low, middle) if near else (middle, high)
    strength = min(high, float(np.sqrt(own.accelerations**2 + 2 * jerk * (np.sqrt(start) - np.sqrt(own.squares)))))
    ramp = (strength + float(own.accelerations)) / jerk
    end = np.sqrt(own.squares) + 0.5 * (strength - own.accelerations) * ramp
    return k, Deceleration(start, strength, max(start - float(end) ** 2, 0.0) / (2 * strength), jerk, ramp)


def from_place(d: Deceleration, place: float, met: Met) -> Deceleration | None:
    """Return the deceleration near `d` that begins to decrease at another `place`, and still meets the knot `met`."""
    end, last = float(np.sqrt(met.squares)), float(met.accelerations)

    def ramp(strength: float) -> tuple[float, float]:
        """Return the time of the ramp, and how much longer its distance is than that to the knot."""
        v = np.sqrt(max(d.start - 2 * strength * place, 0.0))
        time = 2 * (v - end) / (strength - last)
        return time, time * (v + time * (last - 2 * strength) / 6) - (float(met.places) - place)

    before, strength = d.strength * (1 - 1e-6), d.strength
    found = ramp(before)[1]
    for _ in range(SECANTS):
        error = ramp(strength)[1]
        if not abs(error) > ROUNDINGS * float(met.places) or error == found:
            break
        before, found, strength = strength, error, strength - error * (strength - before) / (error - found)
    time = ramp(strength)[0]
    return Deceleration(d.start, strength, place, (strength + last) / time, time) if time > 0 < strength else None
