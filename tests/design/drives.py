"""A drive along a street with bends, with stops in a bend and on a straight, and a slow point."""

from functools import cache

import numpy as np
from scipy.interpolate import PchipInterpolator

import qtraj as qt

RADIUS = 12.0
"""Radius [m] of the tightest bend, in whose middle the vehicle stops."""

STOPS = ((12.0, 17.0), (34.0, 38.0))
"""The stops [s]."""

CREEPING = 25.0
"""The time [s] at which the vehicle almost stops."""

END = 50.0


@cache
def _speed():
    """Return the speed over time, and the distance."""
    knots = [(0, 8), (6, 8), (11.2, 0.6), (12, 0), (17, 0), (17.8, 0.6), (22, 6), (24.2, 1), (25, 0.15), (25.8, 1)]
    knots += [(29, 7), (33.2, 0.6), (34, 0), (38, 0), (38.8, 0.6), (44, 9), (50, 9)]
    rate = PchipInterpolator(*np.array(knots, float).T)
    return rate, rate.antiderivative()


def way(t):
    """Return the distance [m] along the street."""
    return _speed()[1](t)


def street(s):
    """Return the points (n, 3) of the street: straights joined by a bend of 90° around the first stop."""
    middle, half = float(way(STOPS[0][0])), 0.5 * np.pi / 2 * RADIUS
    u = np.linspace(0.0, float(way(END)) + 1.0, 200_001)
    x, y = plan(u, bend(u, middle, half) / RADIUS)
    return np.stack([np.interp(s, u, x), np.interp(s, u, y), 0.02 * s], axis=-1)


def bend(u, middle, half):
    """Return the curvature of a bend at distances `u`, relative to its largest value; it rises over 6 m."""
    inside = np.clip((np.abs(u - middle) - half) / -6.0 + 1.0, 0.0, 1.0)
    return 3 * inside**2 - 2 * inside**3


def plan(u, curvature):
    """Return x and y at equally spaced distances `u` of a street with this curvature."""
    heading = _integral(u, curvature)
    return _integral(u, np.cos(heading)), _integral(u, np.sin(heading))


def _integral(u, f):
    return np.append(0.0, np.cumsum(0.5 * (f[1:] + f[:-1])) * (u[1] - u[0]))


def recorded(noise=0.01, seed=0, rate=10.0):
    """Return a recording of positions with noise [m]."""
    t = np.arange(0.0, END + 0.5 / rate, 1 / rate)
    return qt.Track(t, street(way(t)) + np.random.default_rng(seed).normal(0.0, noise, (len(t), 3)) * (1, 1, 0.3))


@cache
def fitted():
    """Return the fitted drive."""
    return qt.fit_route(recorded())
