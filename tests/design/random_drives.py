"""Random drives along a street with bends: stops, halts and slow points, and ends at rest, slow or fast."""

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from tests.design.drives import bend, plan

import qtraj as qt

LATERAL, RADII = 1.5, (9.0, 30.0)
"""Largest lateral acceleration [m/s²] in the middle of a bend, and its radii [m]."""


class Drive(NamedTuple):
    """A drive: its duration and stops [s], the distance [m] over time, and curvature and points of the street."""

    duration: float
    stops: np.ndarray
    way: PchipInterpolator
    distances: np.ndarray
    curvature: np.ndarray
    points: np.ndarray

    def at(self, t):
        """Return the positions (n, 3) at times."""
        s = self.way(t)
        return np.stack([np.interp(s, self.distances, x) for x in self.points], axis=-1)

    @property
    def largest_curvature(self):
        """The largest curvature [1/m] of the street, from the start to the end of the drive."""
        driven = (self.distances >= 0) & (self.distances <= self.way(self.duration))
        return float(np.abs(self.curvature[driven]).max())

    def recorded(self, noise, rate):
        """Return a recording of positions with noise [m]."""
        t = np.arange(0.0, self.duration + 1e-9, 1 / rate)
        return qt.Track(t, self.at(t) + np.random.default_rng(5).normal(0.0, noise, (len(t), 3)) * (1, 1, 0.3))


@cache
def drive(seed):
    """Return a drive with one to three slow points, which are stops, halts of less than a second, or creeping."""
    rng = np.random.default_rng([77, seed])
    first, last = (rng.choice([0.0, rng.uniform(0.05, 0.5), rng.uniform(4, 9)], p=[0.5, 0.3, 0.2]) for _ in range(2))
    knots, stops, bends = [(0.0, first), (1.0, first + 0.7)], [], [0.0]
    for _ in range(rng.integers(1, 4)):
        t, speed = knots[-1][0] + rng.uniform(3, 6), rng.uniform(4, 9)
        knots += [(t, speed), (t + 3.0, speed)]
        t += 3.0 + rng.uniform(4, 7)
        stay, slowest = [(rng.uniform(2, 6), 0.0), (rng.uniform(0.2, 0.8), 0.0), (0.0, rng.uniform(0.1, 0.5))][
            rng.integers(3)
        ]
        stops += [(t, t + stay)] if stay > 1 else []
        inner = [(t, slowest), (t + stay, slowest)] if stay else [(t, slowest)]
        knots += [(t - 0.8, slowest + 0.6), *inner, (t + stay + 0.8, slowest + 0.6)]
        bends += [knots[-len(inner) - 3][0] - 1.0, t]
    t = knots[-1][0] + rng.uniform(3, 6)
    knots += [(t, rng.uniform(4, 9)), (t + 5.0, last + 0.7), (t + 6.0, last)]
    rate = PchipInterpolator(*np.array(knots).T)
    return Drive(t + 6.0, np.array(stops).reshape(-1, 2), rate.antiderivative(), *_street(rng, rate, [*bends, t + 6.0]))


def _street(rng, rate, times):
    """Return distances along a street, its curvature and its points; it may have bends at these times of the drive."""
    way = rate.antiderivative()
    s = np.linspace(-2.0, float(way(times[-1])) + 2.0, 100_001)
    curvature = np.zeros_like(s)
    for t in times:
        if rng.random() < 0.7:
            largest = min(1 / rng.uniform(*RADII), LATERAL / max(float(rate(t)), 0.1) ** 2)
            half = rng.uniform(2.0, min(0.8 / largest, 12.0))
            own = rng.choice([-1, 1]) * largest * bend(s, float(way(t)) + rng.uniform(-1, 1), half)
            curvature = np.where(np.abs(own) > np.abs(curvature), own, curvature)
    return s, curvature, np.array([*plan(s, curvature), 0.02 * s])
