"""Ask many different questions in one process, to measure its memory.

No two questions agree in their function, limits, motion and shapes together.
"""

import itertools

import numpy as np

import qtraj as qt

COUNT = 200
LIMITS = {
    "curvature": 0.06,
    "torsion": 0.2,
    "speed": 12.0,
    "acceleration": 9.0,
    "lateral_acceleration": 4.0,
    "longitudinal_acceleration": 3.0,
    "slope": 0.5,
    "angular_rate": 1.5,
    "angular_acceleration": 6.0,
    "jerk": 20.0,
    "yaw_rate": 1.0,
    "yaw_acceleration": 5.0,
}
ON_TIMING = ("acceleration", "lateral_acceleration", "longitudinal_acceleration", "jerk", "yaw_rate")
"""Limits of a retiming; a limit on the speed is always added."""

OUTPUTS = ("position", "velocity", "quaternion", "curvature", "torsion", "rate", "speed")
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 9.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-12.6, -1.0, 0.1])
SOON = {"duration": (2.0, 8.0)}
RADIUS, ANGLE, HEIGHT = [20.0, 1.0, 0.3, -0.05, 0.001], [0.2, 0.35, 0.01, -0.002], [1.0, 0.4, 0.05, -0.01]


def subset(names, k):
    """Return the k-th set of one, two or three names, in an order in which neighbours differ much."""
    sets = [given for size in (1, 2, 3) for given in itertools.combinations(names, size)]
    return sets[7 * k % len(sets)]


def limits(names):
    return qt.Limits(**{name: LIMITS[name] for name in names})


def path(k):
    """Return a path with three to five coefficients of the radius and two to four of the angle and of the height."""
    return qt.SpiralHelix(RADIUS[: 3 + k % 3], ANGLE[: 2 + k // 3 % 3], HEIGHT[: 2 + k // 9 % 3], 4.0 + 0.01 * k)


def tune(k):
    motion = ("uniform", "hermite")[k % 2]
    return qt.tune(START, END, limits(subset(tuple(LIMITS), k)), motion=motion, bounds=SOON, starts=1 + k % 3)


def certify(k):
    return qt.certify(path(k), limits(subset(tuple(LIMITS), k)))


def retime(k):
    names = {"speed", *subset(ON_TIMING, k)}
    return qt.retime(path(k), limits(sorted(names)), start_speed=0.0, knots=2 ** (5 + k % 4))


def peak(k):
    return qt.peak(path(k), tuple(LIMITS)[k % len(LIMITS)])


def evaluate(k):
    outputs = subset(OUTPUTS, k)
    return qt.evaluate(path(k), np.linspace(0.0, 4.0, 50 + 37 * k), outputs)


KINDS = (tune, certify, retime, peak, evaluate)


def ask():
    """Ask all questions; each kind of question is asked equally often."""
    for k in range(COUNT):
        KINDS[k % len(KINDS)](k // len(KINDS))
